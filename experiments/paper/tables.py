"""The paper's tables as text: headings, formats and explanations, for the terminal, the README and the report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import floor, isinf
from typing import Any

import pandas as pd

from experiments.formats import percent
from experiments.paper.initialisation import SUCCESS, medians_by_method
from experiments.paper.verdicts import verdict_summary, verdict_texts


@dataclass(frozen=True)
class TextTable:
    """A table ready to print.

    Attributes:
        title: one line.
        head: the headings.
        rows: the cells, as many as headings in each row.
        note: what the columns mean.
        optional: headings of columns that a narrow terminal leaves out, in this order.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str
    optional: Sequence[str] = ()


def paper_tables(results: dict[str, Any]) -> dict[str, TextTable]:
    """Return the tables of `paper.json` by key, those that it holds."""
    written = {"rows": comparison_table, "verdicts": verdict_table, "initialisation": initialisation_table}
    return {name: write(results[name]) for name, write in written.items() if name in results}


def number(form: str) -> Callable[[float | None], str]:
    """Return a formatter of numbers; a dash stands for None and for a time that was not reached."""
    return lambda value: "-" if value is None or pd.isna(value) or isinf(value) else format(value, form)


def violation(value: float | None) -> str:
    """Return the largest violation as a multiple of the limit; None in a results file stands for infinity."""
    return "unbounded" if value is None or isinf(value) else f"{value:.0f}x"


COMPARISON: dict[str, tuple[str, Callable[[Any], str]]] = {
    "scenario": ("case", str),
    "printed_s": ("printed", number("g")),
    "nodes_only_s": ("nodes only", number(".4f")),
    "nodes_only_violation": ("max. violation", violation),
    "flat_certified_s": ("flat, certified", number(".4f")),
    "shooting_s": ("T*, shooting", number(".5f")),
    "pontryagin_s": ("indirect", number(".5f")),
    "reference_8_s": ("[8]", number("g")),
}
"""Headings and formats of the comparison, by key in its rows."""


def comparison_table(rows: Sequence[dict[str, Any]]) -> TextTable:
    """Return the paper's times beside those of each method."""
    known = {key: column for key, column in COMPARISON.items() if key in rows[0]}
    return TextTable(
        "The paper's flight times and ours [s]",
        [title for title, _ in known.values()],
        [[write(row[key]) for key, (_, write) in known.items()] for row in rows],
        "Nodes only: the published transcription, with limits at grid nodes only; max. violation is its largest "
        "violation between nodes, relative to the limit. Flat, certified: the paper's method with all limits kept at "
        "all times. T*: direct multiple shooting. Indirect: Pontryagin's conditions, the method of the paper's "
        "reference [8], for flights in free space.",
        ("[8]", "indirect", "max. violation"),
    )


def verdict_table(rows: Sequence[dict[str, Any]]) -> TextTable:
    """Return which printed times are impossible, and by how much."""
    verdicts = pd.DataFrame(rows)
    texts = verdict_texts(verdicts)
    return TextTable(
        "Which printed times are impossible [s]",
        list(texts),
        texts.to_numpy().tolist(),
        "No flight within the paper's limits is faster than the lower bound. A dual dynamic programme over the tilt "
        "proves it (`optimal.prove`). A certified flight attains the upper bound of T*, at most "
        f"{percent(verdicts['gap'].max(), 2)} above the lower bound. A printed time is impossible if it lies below "
        "the lower bound even with half a unit of its last digit added. The paper does not print g; we take 9.81 "
        f"m/s². {verdict_summary(verdicts)}",
        ("gap",),
    )


def initialisation_table(rows: Sequence[dict[str, Any]]) -> TextTable:
    """Return iterations and times of each method from its default guess, and how many initial guesses succeed."""
    texts = [
        [
            row["method"],
            str(row["cases"]),
            f"{row['iterations']:.0f}",
            f"{row['cold_s']:.2f}",
            f"{row['warm_s']:.3f}",
            f"{row['converged']} of {row['starts']}",
            f"{row['succeeded']} of {row['starts']}",
        ]
        for row in medians_by_method(pd.DataFrame(rows)).to_dict("records")
    ]
    return TextTable(
        "Initialisation: one solve from the default guess, without multi-start",
        ["method, default initial guess", "cases", "iterations", "cold [s]", "warm [s]", "converged", "optimum found"],
        texts,
        "The paper claims that its problem is easily initialised (section II-E). For each method we solve once from "
        "the default guess, without multi-start: iterations and times are medians over the cases. Cold includes "
        "building the nonlinear program, warm does not. The same solve is repeated on several grids: converged counts "
        "the solves that converge, optimum found those whose flight keeps all limits at all times and is within "
        f"{percent(SUCCESS)} of the method's best.",
        ("cases",),
    )


TABLE_I = {
    "scenario": "case",
    "printed_s": "printed [s]",
    "nodes_only_s": "nodes only [s]",
    "flat_certified_s": "flat, certified [s]",
    "shooting_s": "T*, shooting [s]",
    "lower_bound_s": "lower bound [s]",
    "verdict": "printed time",
}
"""Headings of the report's table of the paper, by key in the rows of `table_1`."""


def table_1(paper: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the paper's Table I and its other times beside ours, keyed by TABLE_I; times in [s], None for none.

    Lower bounds are rounded down to the digits shown.
    """
    verdicts = paper.get("verdicts") or []
    texts = verdict_texts(pd.DataFrame(verdicts)).set_index("case")["impossible by"].to_dict() if verdicts else {}
    rows = []
    for row in paper["rows"]:
        by = texts.get(row["scenario"], "-")
        bound = row.get("lower_bound_s")
        rows.append(
            {key: row.get(key) for key in TABLE_I}
            | {"lower_bound_s": None if bound is None else floor(bound * 1e5) / 1e5}
            | {"verdict": f"impossible by {by}" if by[0].isdigit() else by}
        )
    return rows
