"""Measurements of the flat and indirect methods: corridors, other flat systems, orders of convergence.

Each function with a parameter `advance` is a section of `experiments.measurements.solvers`.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import Chebyshev
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline

import optimal
from experiments.files import Row
from experiments.measurements.sections import Advance, convergence_order, uniform_goal
from flatgym import SCENARIOS
from flatgym.quadrotor import Array
from optimal.flat.following import follow
from optimal.flat.initial_guess import motion, slow_start
from optimal.flat.planning import plan, pose
from optimal.flat.program.solver import solve_program
from optimal.flat.refinement import INTERVALS
from optimal.flat.solution import FlatSolution
from optimal.flat.trajectory import FlatTrajectory
from optimal.indirect.pontryagin import fastest
from optimal.paths.corridors import corridor, is_printed, paper_corridor
from optimal.paths.curves import BSplinePath, PolynomialPath
from optimal.systems import FullQuadrotor, OverheadCrane

PRINTED = (
    "horizontal-3",
    "horizontal-6",
    "horizontal-9",
    "horizontal-12",
    "horizontal-15",
    "ground-6",
    "diagonal",
    "hoop",
)
IN_THE_PAPERS_CORRIDOR = {"hoop": 1.41797}
"""T* [s] within the paper's corridor, where it excludes the optimum."""
FIRST_GRIDS = range(16, 61, 4)
"""Numbers of intervals on which the paper's own initial guess is tried."""
GOOD = 5e-3
"""Largest relative gap to the best time that counts as the optimum found."""
RUNS = 3


def flat(quick: bool, advance: Advance) -> list[Row]:
    """How close to T* is the certified flat flight, how long is the solve, how often does the paper's guess succeed?"""
    names, grids = (PRINTED[:1], (16, 32)) if quick else (PRINTED, tuple(FIRST_GRIDS))
    rows = []
    for i, name in enumerate(names):
        walls = paper_corridor(SCENARIOS[name])
        best = IN_THE_PAPERS_CORRIDOR.get(name) or optimal.solve(name, max_gap=None).time
        solutions = [plan(walls.paths, ends=walls.ends) for _ in range(RUNS + 1)]
        found = [plan(walls.paths, ends=walls.ends, intervals=n) for n in grids]
        rows.append(
            {
                "scenario": name,
                "best_s": best,
                "time_s": solutions[0].time,
                "above_best": solutions[0].time / best - 1,
                "cold_s": solutions[0].solve_time,
                "warm_s": statistics.median(s.solve_time for s in solutions[1:]),
                "iterations": solutions[0].iterations,
                "intervals": solutions[0].intervals,
                "certified": optimal.certify(solutions[0].trajectory, SCENARIOS[name]).holds(),
                "starts": len(grids),
                "starts_certified": sum(s.converged and s.optimised for s in found),
                "starts_good": sum(s.time <= best * (1 + GOOD) for s in found),
            }
        )
        advance(i + 1, len(names))
    return rows


def corridors(quick: bool, advance: Advance) -> list[Row]:
    """Is there always a feasible flight in an automatic corridor, and how far is it above T*?"""
    names = ("horizontal-3",) if quick else tuple(SCENARIOS)
    rows = []
    for i, name in enumerate(names):
        walls = corridor(SCENARIOS[name])
        solution = plan(walls.paths, ends=walls.ends)
        best = optimal.solve(name, max_gap=None).time
        rows.append(
            {
                "scenario": name,
                "printed_corridor_too": is_printed(SCENARIOS[name]),
                "best_s": best,
                "time_s": solution.time,
                "above_best": solution.time / best - 1,
                "optimised": solution.optimised,
                "certified": optimal.certify(solution.trajectory, SCENARIOS[name]).holds(),
                "solve_time_s": solution.solve_time,
            }
        )
        advance(i + 1, len(names))
    return rows


def pontryagin(quick: bool, advance: Advance) -> list[Row]:
    """Does the indirect method agree with shooting, in named scenarios and at uniform goals?"""
    generator = np.random.default_rng(8)
    named = ["horizontal-3"] if quick else [*PRINTED[:5], "diagonal", "climb", "drop"]
    tasks = [SCENARIOS[name] for name in named] + [uniform_goal(generator, i) for i in range(1 if quick else 20)]
    rows = []
    for i, task in enumerate(tasks):
        extremal, solution = fastest(task), optimal.solve(task, nodes=400, max_gap=None)
        rows.append(
            {
                "scenario": task.name,
                "goal_m": list(task.goal),
                "winding": extremal.winding,
                "time_s": extremal.time,
                "shooting_s": solution.time,
                "difference": solution.time / extremal.time - 1,
                "residual": extremal.residual,
                "sign_agreement": extremal.sign_agreement,
                "certified": optimal.certify(extremal.trajectory, task).holds(),
            }
        )
        advance(i + 1, len(tasks))
    return rows


def systems(quick: bool, advance: Advance) -> list[Row]:
    """Do flights of other flat systems keep their limits, and do their integrated inputs reach the end state?"""
    cases: dict[str, Callable[[], FlatSolution]] = {
        "crane, lifting over": lambda: follow(PolynomialPath(((0.0, 3.0), (-3.0, 2.0, -2.0))), OverheadCrane()),
        "quadrotor in space, circle of 2 m": lambda: follow(circle(), FullQuadrotor()),
        "quadrotor in space, (6, 0, 0) m": lambda: plan(around((6.0, 0.0, 0.0)), FullQuadrotor()),
        "quadrotor in space, (4, 3, 3) m": lambda: plan(around((4.0, 3.0, 3.0)), FullQuadrotor()),
    }
    chosen = list(cases)[: 1 if quick else None]
    rows = []
    for i, name in enumerate(chosen):
        solution = cases[name]()
        rows.append(
            {
                "case": name,
                "time_s": solution.time,
                "violation": solution.violation,
                "optimised": solution.optimised,
                "replay_error": replay_error(solution.trajectory) if solution.trajectory else np.inf,
                "solve_time_s": solution.solve_time,
            }
        )
        advance(i + 1, len(chosen))
    return rows


def circle(radius: float = 2.0, points: int = 80) -> BSplinePath:
    """Return a level circle for the quadrotor in space (x, y, z, yaw), a spline through `points` of its points."""
    s = np.linspace(0.0, 1.0, points)
    rows = [np.sin(2 * np.pi * s), 1 - np.cos(2 * np.pi * s), 0 * s, 0 * s]
    spline = make_interp_spline(s, radius * np.stack(rows, axis=-1), k=5)
    return BSplinePath(tuple(map(tuple, spline.c.tolist())), 5, tuple(spline.t.tolist()))


def around(goal: tuple[float, float, float], width: float = 1.5) -> list[PolynomialPath]:
    """Return three outer paths with yaw 0 that start on a triangle of radius `width` [m] and end at the goal."""
    way = np.array(goal)
    aside = np.cross(way, [0.0, 0.0, 1.0])
    aside /= np.linalg.norm(aside)
    up = np.cross(aside, way) / np.linalg.norm(way)
    paths = []
    for angle in np.pi / 2 + np.arange(3) * 2 * np.pi / 3:
        begin = width * (np.cos(angle) * aside + np.sin(angle) * up)
        rows = [(b, 0.0, 0.0, 10 * w, -15 * w, 6 * w) for b, w in zip(begin.tolist(), way.tolist(), strict=True)]
        paths.append(PolynomialPath((*rows, (0.0,))))
    return paths


def replay_error(flight: FlatTrajectory) -> float:
    """Return the largest difference between the flight's end state and SciPy's DOP853 run with its inputs.

    Between breakpoints the inputs are smooth. A Chebyshev interpolant replaces them, because the integrator calls them
    often.
    """
    state: Array = flight.state(0.0)
    degree = 24
    nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    for begin, end in zip(flight.breakpoints[:-1], flight.breakpoints[1:], strict=True):
        values = flight.control(begin + (end - begin) * (nodes + 1) / 2)
        inputs = [Chebyshev.fit(nodes, column, degree, domain=[-1, 1]) for column in values.T]

        def slope(t: float, x: Array, inputs: Any = inputs, begin: float = begin, end: float = end) -> Array:
            share = 2 * (t - begin) / (end - begin) - 1
            return flight.system.derivative(x, [float(column(share)) for column in inputs])

        state = solve_ivp(slope, (begin, end), state, method="DOP853", rtol=1e-9, atol=1e-10).y[:, -1]
    return float(np.abs(state - flight.state(flight.duration)).max())


def flat_orders(quick: bool, advance: Advance) -> list[Row]:
    """At which order does the flat transcription converge, before its limits are tightened for the certificate?"""
    grids = (8, 16) if quick else (8, 12, 16, 24, INTERVALS)
    rows: list[Row] = []
    names = PRINTED[: 1 if quick else 2]
    for i, name in enumerate(names):
        walls = paper_corridor(SCENARIOS[name])
        problem = pose(walls.paths, None, walls.ends, "explicit", "certified")
        limit = fastest(SCENARIOS[name], (0,)).time
        times = [motion(problem, solve_program(problem, slow_start(problem, n))).duration for n in grids]
        order = convergence_order(grids, np.array(times) - limit)
        rows += [
            {"scenario": name, "intervals": n, "time_s": t, "error_s": t - limit, "order": order}
            for n, t in zip(grids, times, strict=True)
        ]
        advance(i + 1, len(names))
    return rows
