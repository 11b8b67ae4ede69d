"""Measurements of the solvers: correctness, convergence from random initial guesses, order, and speed.

    flatquad measure solvers [SECTION]... [--quick] [--out FILE]

A new section is a function in SECTIONS.
"""

from __future__ import annotations

import time

import numpy as np

import optimal
from experiments.files import Row
from experiments.measurements import batches, broken_flights, fewest_steps, flat, moving_corridors, proofs, tracks
from experiments.measurements.rockit import rockit_solver
from experiments.measurements.sections import (
    REFERENCE_TIMES,
    Advance,
    Section,
    convergence_order,
    fresh_process,
    in_parallel,
    median,
    uniform_goal,
)
from flatgym import SCENARIOS, Scenario
from optimal.direct.multistart import AGREEMENT
from optimal.direct.program import NODES
from optimal.direct.shooting import solve_winding

GOALS, STARTS = 100, 10
"""Uniform goals, and random initial guesses of each."""
ORDER_CASES = (("horizontal-6", 0), ("diagonal", 0), ("climb", 1))
ORDER_NODES, FINEST = (25, 50, 100, 200, 400), 1600


def references(quick: bool, advance: Advance) -> list[Row]:
    """Is every named scenario solved and certified, at the time known from other code?"""
    names = ["horizontal-3", "climb"] if quick else list(SCENARIOS)
    rows = []
    for i, name in enumerate(names):
        optimal.solve(name, max_gap=None, raise_on_failure=False)  # builds the programs: the timed solve is warm
        row = optimal.solve(name, raise_on_failure=False).row()
        known = REFERENCE_TIMES.get(name)
        rows.append(row | {"reference_s": known, "deviation": row["time_s"] / known - 1 if known else None})
        advance(i + 1, len(names))
    return rows


def starts(quick: bool, advance: Advance) -> list[Row]:
    """How many random initial guesses converge, and how many find the best time? A row a goal, then a total."""
    goals, each = (3, 3) if quick else (GOALS, STARTS)
    generator = np.random.default_rng(0)
    tasks = [(uniform_goal(generator, i), each, i) for i in range(goals)]
    rows = in_parallel(starts_of, tasks, advance)
    total = {key: sum(row[key] for row in rows) for key in ("starts", "converged", "found_best", "solved")}
    return [*rows, {"scenario": "all", **total}]


def starts_of(scenario: Scenario, count: int, seed: int) -> Row:
    """Solve a scenario by `optimal.solve`, then its best winding from `count` random initial guesses."""
    solution = optimal.solve(scenario, max_gap=None, raise_on_failure=False)
    generator = np.random.default_rng((1, seed))
    shots = [solve_winding(scenario, solution.winding, generator=generator) for _ in range(count)]
    times = [shot.trajectory.duration for shot in shots if shot.converged]
    best = min([solution.time, *times])
    return {
        "scenario": scenario.name,
        "goal_m": list(scenario.goal),
        "winding": solution.winding,
        "time_s": solution.time,
        "best_s": best,
        "starts": count,
        "converged": len(times),
        "found_best": sum(value <= best * (1 + AGREEMENT) for value in times),
        "solved": int(solution.time <= best * (1 + AGREEMENT)),
    }


def orders(quick: bool, advance: Advance) -> list[Row]:
    """At which order does the time converge with the grid? Regression of log error on log nodes."""
    cases, nodes, finest = (ORDER_CASES[:1], (25, 50), 200) if quick else (ORDER_CASES, ORDER_NODES, FINEST)
    rows: list[Row] = []
    for i, (name, winding) in enumerate(cases):
        limit = solve_winding(SCENARIOS[name], winding, nodes=finest).trajectory.duration
        times = np.array([solve_winding(SCENARIOS[name], winding, nodes=n).trajectory.duration for n in nodes])
        order = convergence_order(nodes, times - limit)
        rows += [
            {"scenario": name, "winding": winding, "nodes": n, "time_s": t, "error_s": t - limit, "order": order}
            for n, t in zip(nodes, times.tolist(), strict=True)
        ]
        advance(i + 1, len(cases))
    return rows


def speed(quick: bool, advance: Advance) -> list[Row]:
    """How long do a warm solve by shooting and by rockit, interleaved, and the import take? Medians."""
    runs, nodes, imports = (2, 10, 1) if quick else (30, NODES, 7)
    scenario = SCENARIOS["horizontal-6"]
    rockit = rockit_solver(scenario, nodes)

    def ours() -> tuple[float, int]:
        shot = solve_winding(scenario, nodes=nodes)
        return shot.trajectory.duration, shot.iterations

    rows: list[Row] = []
    solvers = {"shooting": ours, "rockit": rockit}
    clock: dict[str, list[float]] = {name: [] for name in solvers}
    answers = {name: solve() for name, solve in solvers.items()}  # the first solve builds the program
    for i in range(runs):
        for name, solve in solvers.items():
            begun = time.perf_counter()
            answers[name] = solve()
            clock[name].append(time.perf_counter() - begun)
        advance(i + 1, runs + imports)
    for name, taken in clock.items():
        duration, iterations = answers[name]
        rows.append({"what": name, "nodes": nodes, "time_s": duration, "iterations": iterations, **median(taken)})
    taken = []
    for i in range(imports):
        taken.append(fresh_process("import optimal"))
        advance(runs + i + 1, runs + imports)
    return [*rows, {"what": "import optimal", **median(taken)}]


SECTIONS: dict[str, Section] = {
    "references": references,
    "starts": starts,
    "orders": orders,
    "speed": speed,
    "flat": flat.flat,
    "flat_orders": flat.flat_orders,
    "corridors": flat.corridors,
    "flat_flights": moving_corridors.flat_flights,
    "flat_draws": moving_corridors.flat_draws,
    "flat_convergence": moving_corridors.flat_convergence,
    "pontryagin": flat.pontryagin,
    "systems": flat.systems,
    "batch": batches.batch,
    "bounds": proofs.bounds,
    "goal_bounds": proofs.goal_bounds,
    "validity": proofs.validity,
    "steps": fewest_steps.steps,
    "goal_steps": fewest_steps.goal_steps,
    "broken": broken_flights.broken,
    "warm": proofs.warm,
    "convergence": tracks.convergence,
    "hoops": tracks.hoops,
    "random_tracks": tracks.random_tracks,
    "track_validity": tracks.track_validity,
    "sampled_steps": tracks.sampled_steps,
}
"""The sections by name."""
