"""TODO experiments/publishing/paper.py."""

from __future__ import annotations

from collections.abc import Callable
from textwrap import fill
from typing import Any

import pandas as pd

from experiments.paper.initialisation import SUCCESS, by_road
from experiments.paper.verdicts import judgement, verdicts
from experiments.publishing.markdown import markdown


def paper(results: dict[str, Any]) -> str:
    """Return what became of the paper's times: beside what can be flown, judged, and how easily each was found."""
    parts = {"rows": compared, "judged": judged, "ease": initialisation_table}
    return "\n\n".join(written(results[name]) for name, written in parts.items() if name in results)


def compared(rows: list[dict[str, Any]]) -> str:
    """Return the paper's times beside those of each road."""

    def number(form: str) -> Callable[[float | None], str]:
        return lambda value: "-" if value is None else format(value, form)

    columns: dict[str, tuple[str, Callable[[Any], str]]] = {
        "scenario": ("case", str),
        "printed_s": ("printed", number("g")),
        "nodes_only_s": ("nodes only", number(".4f")),
        "nodes_only_violation": ("its excess", lambda value: "unbounded" if value is None else f"{value:.0f}x"),
        "flat_certified_s": ("flat, certified", number(".4f")),
        "shooting_s": ("T* (shooting)", number(".5f")),
        "pontryagin_s": ("Pontryagin", number(".5f")),
        "reference_8_s": ("[8]", number("g")),
    }
    known = {key: column for key, column in columns.items() if key in rows[0]}
    head = [title for title, _ in known.values()]
    return markdown(head, [[written(row[key]) for key, (_, written) in known.items()] for row in rows])


def judged(rows: list[dict[str, Any]]) -> str:
    """Return which printed times are impossible, and by how much, with the picture of it."""
    table = pd.DataFrame(rows)
    read = verdicts(table)
    verdict = markdown(list(read), read.to_numpy().tolist())
    words = (
        "The paper judged: no flight within its limits is faster than the bound. A dual dynamic programme over the "
        f"tilt proves it (`optimal.prove`); our flights take {table['gap'].max():.2%} longer at most. A printed time "
        "is impossible if it lies below the bound even with half a unit of its last digit added. The paper does not "
        f"print g; we take 9.81 m/s². {judgement(table)}"
    )
    picture = "![Printed and flown times against the proven bound](experiments/results/published/judged.svg)"
    return "\n\n".join([fill(words, 118, break_on_hyphens=False), verdict, picture])


def initialisation_table(rows: list[dict[str, Any]]) -> str:
    """Return the roads' iterations and seconds, medians over the cases, and how many starts arrive."""
    table = [
        [
            row["road"],
            str(row["cases"]),
            f"{row['iterations']:.0f}",
            f"{row['cold_s']:.2f}",
            f"{row['warm_s']:.3f}",
            f"{row['converged']} of {row['starts']}",
            f"{row['succeeded']} of {row['starts']}",
        ]
        for row in by_road(pd.DataFrame(rows)).to_dict("records")
    ]
    head = ["road, from a plain start", "cases", "iterations", "cold [s]", "warm [s]", "converged", "found"]
    words = (
        "The paper argues that its problem is easily started. So for each road one solve from a plain start, without "
        "any search: iterations and seconds, medians over the cases; cold has the program yet to be built. And such "
        "starts on several grids: how many converge, and how many end in a flight that keeps all limits at all times "
        f"and is within {SUCCESS:.1%} of the road's best."
    )
    return fill(words, 118) + "\n\n" + markdown(head, table)
