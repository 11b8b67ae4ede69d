"""Measurements of the flat method in corridors around flights: named scenarios, and samples of distributions.

Each function with a parameter `advance` is a section of `experiments.measurements.solvers`.
"""

from __future__ import annotations

import math
import statistics
import time
from dataclasses import replace

import numpy as np

import optimal
from experiments.files import Row
from experiments.measurements.sections import Advance, in_parallel
from flatgym import DISTRIBUTIONS, SCENARIOS, Scenario
from flatgym.quadrotor import Array
from flatgym.scenarios.catalogue import scenario
from optimal.direct.shooting import WINDINGS, solve_coarse
from optimal.flat.moving_corridor import follow_flight
from optimal.flat.search import starting_flights
from optimal.flights.trajectory import Flight

DRAWS = 100
"""Scenarios of each distribution."""
STEEP = (1e-6, 1e-4, 1e-2, 0.1, 0.5, 1.0)
"""Distances to the side of goals 5 m above and below the start [m]."""
CONVERGING, WEAK = {"slalom": 2, "loop": -1}, 16.0
"""Scenarios of `flat_convergence` with the winding of T*, and the greatest thrust of the flights they start from
[m/s^2]."""
SHARES = np.linspace(0.0, 1.0, 81)
"""Path coordinates, or shares of a duration, of the points of a drawn line."""


def flat_flights(quick: bool, advance: Advance) -> list[Row]:
    """How close to T* is the flat method in corridors around flights, and how long does it take?"""
    names = ("horizontal-3",) if quick else tuple(SCENARIOS)
    rows = []
    for i, name in enumerate(names):
        optimal.solve(name, "flat", max_gap=None, raise_on_failure=False)  # builds the programs
        begun = time.perf_counter()
        starting_flights(SCENARIOS[name], WINDINGS)
        start = time.perf_counter() - begun
        rows.append(flat_row(SCENARIOS[name]) | {"start_s": start})
        advance(i + 1, len(names))
    return rows


def flat_convergence(quick: bool, advance: Advance) -> list[Row]:
    """How do corridors lead from the flight of a weaker vehicle to the optimum?"""
    rows = []
    converging = {"horizontal-3": 0} if quick else CONVERGING
    for i, (name, winding) in enumerate(converging.items()):
        task = SCENARIOS[name]
        start = solve_coarse(replace(task, quadrotor=replace(task.quadrotor, thrust_max=WEAK)), winding)
        steps = list(follow_flight(task, start.trajectory, start.passings))
        rows.append(
            {
                "scenario": name,
                "thrust_max_of_start": WEAK,
                "times_s": [start.trajectory.duration, *(step.solution.time for step in steps)],
                "best_s": optimal.solve(task, max_gap=None).time,
                "certified": [step.certificate.holds() for step in steps],
                "flights_m": [line(start.trajectory), *(line(step.solution.trajectory) for step in steps)],
                "outer_paths_m": [[polyline(path(SHARES)) for path in step.corridor.paths] for step in steps],
            }
        )
        advance(i + 1, len(converging))
    return rows


def line(flight: Flight | None) -> list[list[float]]:
    """Return points of a flight at equal time steps, rows (x, z) [m]."""
    assert flight is not None
    return polyline(flight(SHARES * flight.duration))


def polyline(points: Array) -> list[list[float]]:
    """Return points rounded to a tenth of a millimetre, rows (x, z) [m]."""
    return [[float(value) for value in row] for row in np.round(points, 4)]


def flat_draws(quick: bool, advance: Advance) -> list[Row]:
    """How often is the flat method certified, and how far above T*, on samples and beside the vertical?"""
    names, count = (("random-goal",), 1) if quick else (("random-goal", "random-hoops"), DRAWS)
    kinds = {name: [DISTRIBUTIONS[name].scenario(i) for i in range(count)] for name in names}
    if not quick:
        climb, steep = scenario("climb"), [(side, height) for height in (5.0, -5.0) for side in STEEP]
        kinds["beside the vertical"] = [replace(climb, name=f"steep-{goal}", goal=goal) for goal in steep]
    tasks = [(kind, task) for kind, sampled in kinds.items() for task in sampled]
    measured = in_parallel(kind_row, tasks, advance)
    rows = []
    for kind in kinds:
        of_kind = [row for row in measured if row["kind"] == kind]
        above = [row["above_best"] for row in of_kind if math.isfinite(row["time_s"])]
        rows.append(
            {
                "kind": kind,
                "scenarios": len(of_kind),
                "certified": len(above),
                "above_best_median": statistics.median(above) if above else math.nan,
                "above_best_largest": max(above, default=math.nan),
                "within_half_percent": sum(value <= 5e-3 for value in above),
                "median_s": statistics.median(row["solve_time_s"] for row in of_kind),
                "failed": [row["scenario"] for row in of_kind if not math.isfinite(row["time_s"])],
            }
        )
    return rows


def kind_row(kind: str, task: Scenario) -> Row:
    """Return the row of a scenario of a kind."""
    return flat_row(task) | {"kind": kind}


def flat_row(task: Scenario) -> Row:
    """Return the flat method's flight of a scenario beside the one of shooting."""
    begun = time.process_time()
    flat = optimal.solve(task, "flat", max_gap=None, raise_on_failure=False)
    spent = time.process_time() - begun  # without the starts, whose solver is a process of its own
    best = optimal.solve(task, max_gap=None, raise_on_failure=False)
    return {
        "scenario": task.name,
        "time_s": flat.time,
        "best_s": best.time,
        "above_best": flat.time / best.time - 1,
        "winding": flat.winding,
        "starts": flat.starts,
        "times_s": [step.solution.time for step in flat.corridors],
        "certified": flat.certificate.holds(),
        "solve_time_s": flat.solve_time,
        "processor_time_s": spent,
    }
