"""`flatquad list`: the named scenarios with their best-known solutions, and the distributions."""

from __future__ import annotations

from typing import Any

import pandas as pd

import flatgym
from experiments.cli.options import AsJson
from experiments.formats import lower_bound
from experiments.terminal import cell, paragraph, show, table
from flatgym import Distribution, Scenario
from flatgym.scenarios.reference import reference

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


def scenario_row(scenario: Scenario) -> dict[str, Any]:
    """Return a named scenario and its best-known solution."""
    known = reference(scenario)
    return {
        "scenario": scenario.name,
        "kind": "scenario",
        "start": _point(scenario.start),
        "goal": _point(scenario.goal),
        "hoops": len(scenario.hoops),
        "floor": scenario.floor,
        "dt_s": scenario.dt,
        "time_s": known.time if known else None,
        "lower_bound_s": known.time_lower_bound if known else None,
        "k_star": known.k_star if known else None,
        "k_lower_bound": known.k_lower_bound if known else None,
        "proven": known.proven if known else None,
    }


def distribution_row(distribution: Distribution) -> dict[str, Any]:
    """Return a distribution under the same keys; the optima of its scenarios are None."""
    low, high = distribution.hoops
    goal = f"within {distribution.half_width:g} m in x and z, at least {distribution.least_distance:g} m away"
    if distribution.leg is not None:
        shortest, longest = distribution.leg
        goal = f"the end of a track with legs of {shortest:g} to {longest:g} m"
    return {
        "scenario": distribution.name,
        "kind": "distribution",
        "start": _point((0.0, 0.0)),
        "goal": goal,
        "hoops": low if low == high else f"{low} to {high}",
        "floor": None,
        "dt_s": distribution.dt,
        **dict.fromkeys(("time_s", "lower_bound_s", "k_star", "k_lower_bound", "proven")),
    }


def _point(point: tuple[float, float]) -> str:
    return f"({point[0]:g}, {point[1]:g})"
