"""TODO experiments/paper/initialisation.py."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import Any

import pandas as pd

import optimal
from flatgym import SCENARIOS, Scenario
from optimal.direct.program import NODES
from optimal.direct.shooting import solve_winding
from optimal.flat.planning import plan
from optimal.flat.refinement import INTERVALS
from optimal.flights.trajectory import Flight
from optimal.indirect.arcs import arcs_of
from optimal.indirect.pontryagin import refine
from optimal.paths.corridors import paper_corridor

INITIALISATION_COLUMNS = (
    "scenario",
    "road",
    "best_s",
    "iterations",
    "cold_s",
    "warm_s",
    "starts",
    "converged",
    "succeeded",
)

INTERVAL_COUNTS = (20, 30, 40, 50, 60)
"""Grids of the flat roads' plain starts."""
NODE_COUNTS = (50, 75, 100, 150, 200)
"""Grids of the plain starts of shooting, and of the direct solutions that Pontryagin's conditions begin from."""
SUCCESS = 5e-3
"""How much slower than the road's fastest a certified flight may be, relatively, to count as found."""


@dataclass(frozen=True)
class Run:
    """One solve from one plain start: whether the solver `converged`, its `iterations`, the `flight` or None."""

    converged: bool
    iterations: int
    flight: Flight | None


def flat(scenario: Scenario, intervals: int, checks: str) -> Run:
    """Solve eq. (10) from the slow start on the central path, section II-E."""
    outer = paper_corridor(scenario)
    found = plan(outer.paths, scenario.quadrotor, ends=outer.ends, checks=checks, intervals=intervals)
    return Run(found.converged, found.iterations, found.trajectory)


def shooting(scenario: Scenario, nodes: int) -> Run:
    """Solve the shooting problem without a turn, from the straight line."""
    found = solve_winding(scenario, nodes=nodes)
    return Run(found.converged, found.iterations, found.trajectory if found.converged else None)


def pontryagin(scenario: Scenario, nodes: int) -> Run:
    """Solve Pontryagin's conditions with the arcs of the direct solution of `shooting`.

    Its iterations are the evaluations of the conditions, after the direct solution's.
    """
    direct = solve_winding(scenario, nodes=nodes)
    if not direct.converged:
        return Run(False, direct.iterations, None)
    found = refine(scenario, 0, *arcs_of(direct))
    return Run(found.converged, direct.iterations + found.evaluations, found.trajectory)


ROADS: dict[str, tuple[Callable[[Scenario, int], Run], int, tuple[int, ...]]] = {
    "flat, nodes only": (partial(flat, checks="nodes"), INTERVALS, INTERVAL_COUNTS),
    "flat, certified": (partial(flat, checks="certified"), INTERVALS, INTERVAL_COUNTS),
    "shooting": (shooting, NODES, NODE_COUNTS),
    "pontryagin": (pontryagin, NODES, NODE_COUNTS),
}
"""The roads by name: one solve from a plain start, the grid on which it is timed, the grids of the starts."""


def initialisation_study(name: str, road: str) -> dict[str, Any]:
    """Return how easily a road is travelled in one case, keyed by EASE_COLUMNS.

    A start has `succeeded` if its flight is certified in continuous time, and within SUCCESS of the
    road's fastest; what holds at nodes only never does.

    Args:
        name: a case of PRINTED.
        road: a key of ROADS.
    """
    scenario, (solve, size, sizes) = SCENARIOS[name], ROADS[road]
    cold, _ = timed(lambda: solve(scenario, size))
    warm, run = timed(lambda: solve(scenario, size))
    runs = [solve(scenario, grid) for grid in sizes]
    times = [certified_time(scenario, each) for each in [run, *runs]]
    best = min(times)
    return {
        "scenario": name,
        "road": road,
        "best_s": best,
        "iterations": run.iterations,
        "cold_s": cold,
        "warm_s": warm,
        "starts": len(sizes),
        "converged": sum(each.converged for each in runs),
        "succeeded": sum(duration < inf and duration <= best * (1 + SUCCESS) for duration in times[1:]),
    }


def certified_time(scenario: Scenario, run: Run) -> float:
    """Return the flight time [s], or inf where the certificate does not hold."""
    if run.flight is None or not optimal.certify(run.flight, scenario).holds():
        return inf
    return run.flight.duration


def timed(solve: Callable[[], Run]) -> tuple[float, Run]:
    """Return the wall time of a solve [s] and its result."""
    begun = time.perf_counter()
    run = solve()
    return time.perf_counter() - begun, run


def by_road(initialisation_study: pd.DataFrame) -> pd.DataFrame:
    """Return the ease table with one row a road: cases, medians over them, and sums of starts."""
    grouped = initialisation_study.groupby("road", sort=False)
    medians, sums = ["iterations", "cold_s", "warm_s"], ["starts", "converged", "succeeded"]
    return pd.concat(
        [grouped.size().rename("cases"), grouped[medians].median(), grouped[sums].sum()], axis=1
    ).reset_index()
