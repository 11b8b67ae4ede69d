"""Measurements of the lower bounds: gap, validity and wall time.

Each function with a parameter `advance` is a section of `experiments.measurements.solvers`.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import replace

import numpy as np

import optimal
from experiments.files import Row
from experiments.measurements.sections import Advance, in_parallel, uniform_goal
from flatgym import SCENARIOS, Quadrotor, Scenario
from optimal import prove
from optimal.proof.lower_bound import Proof

LIMITS = {
    "the paper's": Quadrotor(),
    "strong and slow to turn": Quadrotor(thrust_min=0.5, thrust_max=30.0, rate_max=5.0),
    "weak and quick to turn": Quadrotor(thrust_min=3.0, thrust_max=14.0, rate_max=20.0),
}
VALIDATED, GOALS = 300, 100
"""Uniform goals: of each vehicle in `validity`, and in `goal_bounds`."""
CLOSE, BUDGET, LONG_BUDGET = 2e-4, 60.0, 120.0
"""Requested gap, time budget with at most one hoop [s], and time budget with more hoops [s]."""


def proof_row(proof: Proof) -> Row:
    """Return a proof as a row; `checked` states whether its exclusions were recomputed and hold."""
    return {
        "scenario": proof.scenario.name,
        "upper_bound_s": proof.flown,
        "lower_bound_s": proof.time,
        "gap": proof.gap,
        "verdict": proof.verdict.value,
        "branches": len(proof.excluded),
        "windings": len({branch.winding for branch, _ in proof.excluded}),
        "evaluations": proof.evaluations,
        "wall_time_s": proof.wall_time,
        "checked": proof.check(),
    }


def bounds(quick: bool, advance: Advance) -> list[Row]:
    """How small is the gap of each named scenario, and how long does a gap of 0.1 % take?

    Proofs run one after the other in a warm process. The wall time excludes search and certificate.
    """
    names = ["horizontal-3", "hoop"] if quick else list(SCENARIOS)
    prove("horizontal-3", max_gap=0.01)  # compiles the kernel, or loads it
    rows = []
    for i, name in enumerate(names):
        many = len(SCENARIOS[name].hoops) > 1
        usual = prove(name, time_budget=BUDGET)
        tight = prove(name, max_gap=CLOSE, time_budget=LONG_BUDGET if many else BUDGET)
        row = proof_row(tight)
        row |= {"gap_asked": CLOSE, "to_0.1%_s": usual.wall_time if usual.gap <= 1e-3 else None}
        rows.append(row)
        advance(i + 1, len(names))
    return rows


def goal_bounds(quick: bool, advance: Advance) -> list[Row]:
    """How small are the gaps of uniform goals if 0.1 % is requested? A row a goal, then a total."""
    generator = np.random.default_rng(5)
    tasks = [(uniform_goal(generator, i),) for i in range(4 if quick else GOALS)]
    rows = in_parallel(goal_bound, tasks, advance)
    gaps, times = [row["gap"] for row in rows], [row["wall_time_s"] for row in rows]
    total = {
        "gap_median": statistics.median(gaps),
        "gap_worst": max(gaps),
        "wall_time_median_s": statistics.median(times),
    }
    return [*rows, {"scenario": "all", "goals": len(rows), **total}]


def goal_bound(goal: Scenario) -> Row:
    """Return the row of one goal."""
    return proof_row(prove(goal)) | {"goal_m": list(goal.goal)}


def validity(quick: bool, advance: Advance) -> list[Row]:
    """Is a bound ever above the time of a certified flight? Uniform goals, three vehicles; one row a vehicle.

    The flights are the fastest that `optimal.solve` finds on 100 and on 400 nodes.
    """
    generator, count = np.random.default_rng(23), 2 if quick else VALIDATED
    goals = [uniform_goal(generator, i) for i in range(count)]
    tasks = [(name, replace(goal, quadrotor=LIMITS[name])) for name in LIMITS for goal in goals]
    compared = in_parallel(bound_and_flight, tasks, advance)
    rows = []
    for name in LIMITS:
        of_limits = [row for row in compared if row["limits"] == name]
        gaps = [row["gap"] for row in of_limits]
        rows.append(
            {
                "limits": name,
                "goals": len(of_limits),
                "certified": sum(np.isfinite(row["upper_bound_s"]) for row in of_limits),
                "above_a_flight": sum(row["lower_bound_s"] > row["upper_bound_s"] for row in of_limits),
                "checked": sum(row["checked"] for row in of_limits),
                "least_gap": min(gaps),
                "gap_median": statistics.median(gaps),
                "gap_worst": max(gaps),
            }
        )
    return rows


def bound_and_flight(limits: str, goal: Scenario) -> Row:
    """Return the lower bound of a goal, with a requested gap of 0.02 %, and its fastest certified flight."""
    proof = prove(goal, max_gap=CLOSE, time_budget=2.0)
    times = [optimal.solve(goal, nodes=nodes, max_gap=None, raise_on_failure=False).time for nodes in (100, 400)]
    flown = min(times)
    return {
        "limits": limits,
        "lower_bound_s": proof.time,
        "upper_bound_s": flown,
        "gap": flown / proof.time - 1,
        "checked": proof.check(),
    }


def warm(quick: bool, advance: Advance) -> list[Row]:
    """How long are a warm solve of `hoop` with its certificate, and the proofs of named scenarios? Medians."""
    runs, free = 2 if quick else 15, [name for name, task in SCENARIOS.items() if not task.hoops]
    optimal.solve("hoop", max_gap=None)  # builds the programs
    taken = []
    for i in range(runs):
        begun = time.perf_counter()
        optimal.solve("hoop", max_gap=None)
        taken.append(time.perf_counter() - begun)
        advance(i + 1, runs)
    rows: list[Row] = [
        {"what": "solve hoop", "median_s": statistics.median(taken), "worst_s": max(taken), "runs": runs}
    ]
    for name in free[:1] if quick else [*free, "hoop", "high-hoop"]:
        taken = [prove(name).wall_time for _ in range(3)]
        rows.append({"what": name, "median_s": statistics.median(taken), "worst_s": max(taken), "runs": len(taken)})
    median = statistics.median(row["median_s"] for row in rows if row["what"] in free)
    return [*rows, {"what": "lower_bound, median over the named scenarios without hoops", "median_s": median}]
