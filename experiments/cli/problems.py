"""`flatquad list`: the named scenarios with their best-known solutions, and the distributions."""

from __future__ import annotations

from typing import Any

import pandas as pd

import flatgym
from experiments.cli.options import AsJson
from experiments.cli.rows import distribution_row, scenario_row
from experiments.formats import lower_bound
from experiments.terminal import cell, paragraph, show, table

EXAMPLES = "Example: flatquad list --json"


def list_problems(as_json: AsJson = False) -> None:
    """List the named scenarios with their best-known solutions, and the distributions of random scenarios."""
    scenarios = [scenario_row(scenario) for scenario in flatgym.SCENARIOS.values()]
    distributions = [distribution_row(distribution) for distribution in flatgym.DISTRIBUTIONS.values()]
    if as_json:
        # dtype object keeps whole numbers whole in columns that also hold None.
        show(pd.DataFrame([*scenarios, *distributions], dtype=object), as_json)
        return
    head = ["scenario", "goal [m]", "hoops", "floor", "T* [s]", "lower bound", "K*", "proven"]
    table("Scenarios", head, [known_solution(row) for row in scenarios], optional=("floor", "hoops"))
    paragraph(
        "T*: the best-known flight time, exactly from rest to rest; no flight is faster than the lower bound. "
        "K*: the fewest environment steps known, with the tolerance at the goal; proven if no flight takes fewer."
    )
    keys = ("scenario", "goal", "hoops")
    table(
        "Distributions", ["distribution", "goal, one for each episode", "hoops"],
        [[cell(row[key]) for key in keys] for row in distributions],
    )  # fmt: skip


def known_solution(row: dict[str, Any]) -> list[str]:
    """Return the cells of a scenario; the lower bound is rounded down."""
    keys = ("scenario", "goal", "hoops", "floor")
    time, bound = row["time_s"], row["lower_bound_s"]
    return [
        *(cell(row[key]) for key in keys),
        "-" if time is None else f"{time:.5f}",
        "-" if bound is None else lower_bound(bound),
        cell(row["k_star"]),
        "-" if row["proven"] is None else "yes" if row["proven"] else "no",
    ]
