"""How easily each method is initialised: one solve from its default initial guess, without multi-start.

The paper argues that its problem "can be initialized easily" (section II-E). For each method and case this module
counts iterations, measures cold and warm solve times, and counts the grids on which the solve finds the optimum.
"""

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
from optimal.indirect.pontryagin import solve_structure
from optimal.paths.corridors import paper_corridor

INITIALISATION_COLUMNS = (
    "scenario",
    "method",
    "best_s",
    "iterations",
    "cold_s",
    "warm_s",
    "starts",
    "converged",
    "succeeded",
)

INTERVAL_COUNTS = (20, 30, 40, 50, 60)
"""Grid intervals of the flat methods' repeated solves."""
NODE_COUNTS = (50, 75, 100, 150, 200)
"""Grid nodes of the repeated shooting solves, and of the direct solutions that initialise the indirect method."""
SUCCESS = 5e-3
"""Largest relative gap of a certified flight to the method's best that counts as the optimum found."""


@dataclass(frozen=True)
class Run:
    """One solve from the default guess: whether it `converged`, its `iterations`, the `flight` or None."""

    converged: bool
    iterations: int
    flight: Flight | None


def flat(scenario: Scenario, intervals: int, checks: str) -> Run:
    """Solve eq. (10) from the slow motion along the central path (section II-E)."""
    outer = paper_corridor(scenario)
    found = plan(outer.paths, scenario.quadrotor, ends=outer.ends, checks=checks, intervals=intervals)
    return Run(found.converged, found.iterations, found.trajectory)


def shooting(scenario: Scenario, nodes: int) -> Run:
    """Solve the shooting problem with winding 0 from the straight line."""
    found = solve_winding(scenario, nodes=nodes)
    return Run(found.converged, found.iterations, found.trajectory if found.converged else None)


def pontryagin(scenario: Scenario, nodes: int) -> Run:
    """Solve Pontryagin's conditions, initialised by the arcs of the direct solution of `shooting`.

    `iterations` adds the direct solution's iterations and the evaluations of the conditions.
    """
    direct = solve_winding(scenario, nodes=nodes)
    if not direct.converged:
        return Run(False, direct.iterations, None)
    found = solve_structure(scenario, 0, *arcs_of(direct))
    return Run(found.converged, direct.iterations + found.evaluations, found.trajectory)


METHODS: dict[str, tuple[Callable[[Scenario, int], Run], int, tuple[int, ...]]] = {
    "flat, nodes only": (partial(flat, checks="nodes"), INTERVALS, INTERVAL_COUNTS),
    "flat, certified": (partial(flat, checks="certified"), INTERVALS, INTERVAL_COUNTS),
    "shooting": (shooting, NODES, NODE_COUNTS),
    "pontryagin": (pontryagin, NODES, NODE_COUNTS),
}
"""The methods by name: one solve from the default guess, the grid that is timed, the grids of the repeated solves."""


def initialisation_study(name: str, method: str) -> dict[str, Any]:
    """Return how easily a method is initialised in one case, keyed by INITIALISATION_COLUMNS.

    A solve has `succeeded` if its flight is certified in continuous time and within SUCCESS of the method's best.
    A flight that keeps its limits at nodes only is never certified.

    Args:
        name: a case of PRINTED.
        method: a key of METHODS.
    """
    scenario, (solve, size, sizes) = SCENARIOS[name], METHODS[method]
    cold, _ = timed(lambda: solve(scenario, size))
    warm, run = timed(lambda: solve(scenario, size))
    runs = [solve(scenario, grid) for grid in sizes]
    times = [certified_time(scenario, each) for each in [run, *runs]]
    best = min(times)
    return {
        "scenario": name,
        "method": method,
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


def medians_by_method(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row a method: the number of cases, medians over them, and sums of the repeated solves."""
    grouped = rows.groupby("method", sort=False)
    medians, sums = ["iterations", "cold_s", "warm_s"], ["starts", "converged", "succeeded"]
    return pd.concat(
        [grouped.size().rename("cases"), grouped[medians].median(), grouped[sums].sum()], axis=1
    ).reset_index()
