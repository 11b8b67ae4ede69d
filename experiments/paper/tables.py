"""The paper's results beside ours: what it printed, what its transcription gives, what can be flown.

`compare` answers for one case, Table I, the ground constraint, the displacement to (5, 5) or the hoop,
at which time each road arrives. The printed numbers are facts of the paper; all others are computed here.

`judge` asks which printed times are impossible: below a proven lower bound of the flight time, under the
paper's own limits, even if the last printed digit was rounded down.

`initialisation_study` looks into the paper's argument that its problem "can be initialized easily" (section II-E): for
each road, with a plain start and no search, how many iterations and seconds it takes, and how often it
arrives. Seconds are told cold, with the program yet to be built, and warm; so every question of `tables`
is answered in a process of its own.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from math import floor
from typing import Any

import pandas as pd

from experiments.paper.comparison import COLUMNS, compare
from experiments.paper.initialisation import INITIALISATION_COLUMNS, ROADS, initialisation_study
from experiments.paper.printed import PRINTED, in_free_space
from experiments.paper.verdicts import JUDGED_COLUMNS, judge, verdicts

PROCESSES = 2


TABLES: dict[str, tuple[Callable[..., dict[str, Any]], tuple[str, ...]]] = {
    "rows": (compare, COLUMNS),
    "judged": (judge, JUDGED_COLUMNS),
    "ease": (initialisation_study, INITIALISATION_COLUMNS),
}
"""The tables by their names in results files: what answers for one row, and the columns."""


def questions() -> list[tuple[str, tuple[str, ...]]]:
    """Return the table of every row, and the case, or case and road, that it answers for."""
    cases = [(table, (name,)) for table in ("rows", "judged") for name in PRINTED]
    roads = [(name, road) for name in PRINTED for road in ROADS if road != "pontryagin" or in_free_space(name)]
    return [*cases, *(("ease", pair) for pair in roads)]


def answer(question: tuple[str, tuple[str, ...]]) -> dict[str, Any]:
    """Return the row that answers one of the `questions`."""
    table, about = question
    return TABLES[table][0](*about)


def tables(progress: Callable[[], Any] = lambda: None) -> dict[str, pd.DataFrame]:
    """Return the TABLES by name; `progress` is called after each of the `questions`.

    Each is answered in a new process, so that cold is cold.
    """
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in TABLES}
    asked = questions()
    with multiprocessing.get_context("spawn").Pool(PROCESSES, maxtasksperchild=1) as pool:
        for (table, _), row in zip(asked, pool.imap(answer, asked), strict=True):
            rows[table].append(row)
            progress()
    return {name: pd.DataFrame(rows[name], columns=list(columns)) for name, (_, columns) in TABLES.items()}


TABLE_I = {
    "scenario": "case",
    "printed_s": "printed [s]",
    "nodes_only_s": "nodes only [s]",
    "flat_certified_s": "flat, certified [s]",
    "shooting_s": "T*, shooting [s]",
    "lower_bound_s": "lower bound [s]",
    "verdict": "printed time",
}
"""Columns of the paper's table, by their keys in the data block."""


def table_1(paper: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the paper's Table I and its other times beside ours, keyed by TABLE_I; times in [s], None for none.

    The bound is rounded down to the digits shown, so that it stays one.
    """
    judged = paper.get("judged") or []
    words = verdicts(pd.DataFrame(judged)).set_index("case")["impossible by"].to_dict() if judged else {}
    rows = []
    for row in paper["rows"]:
        by = words.get(row["scenario"], "-")
        bound = row.get("lower_bound_s")
        rows.append(
            {key: row.get(key) for key in TABLE_I}
            | {"lower_bound_s": None if bound is None else floor(bound * 1e5) / 1e5}
            | {"verdict": f"impossible by {by}" if by[0].isdigit() else by}
        )
    return rows
