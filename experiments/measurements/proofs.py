"""Measurements of the proofs: validity and gap of the lower bounds, proofs of K*, wall times.

Each function with a parameter `advance` is a section of `experiments.measurements.solvers`.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields, replace
from typing import Any

import gymnasium as gym
import joblib
import numpy as np

import optimal
from experiments.files import Row
from experiments.measurements.sections import Advance, uniform_goal
from flatgym import SCENARIOS, Quadrotor, Scenario
from flatgym.envs.vector import FlatQuadVectorEnv
from optimal import Certificate, FewestSteps, Trajectory, certify, prove
from optimal.proof.branch_and_bound import windings
from optimal.proof.lower_bound import Proof

PROCESSES = 2
LIMITS = {
    "the paper's": Quadrotor(),
    "strong and slow to turn": Quadrotor(thrust_min=0.5, thrust_max=30.0, rate_max=5.0),
    "weak and quick to turn": Quadrotor(thrust_min=3.0, thrust_max=14.0, rate_max=20.0),
}
VALIDATED, GOALS, STEPPED = 300, 100, 200
"""Uniform goals: of each vehicle in `validity`, in `goal_bounds`, and in `goal_steps`."""
CLOSE, BUDGET, LONG_BUDGET = 2e-4, 60.0, 600.0
"""Requested gap, time budget with at most one hoop [s], and time budget with more hoops [s]."""


def in_parallel(function: Callable[..., Row], tasks: Iterable[Sequence[Any]], advance: Advance) -> list[Row]:
    """Return `function(*task)` of all tasks, in their order."""
    calls = [joblib.delayed(function)(*task) for task in tasks]
    rows: list[Row] = []
    for row in joblib.Parallel(n_jobs=PROCESSES, return_as="generator")(calls):
        rows.append(row)
        advance(len(rows), len(calls))
    return rows


def proof_row(proof: Proof) -> Row:
    """Return a proof as a row; `checked` states whether its exclusions were recomputed and hold."""
    return {
        "scenario": proof.scenario.name,
        "upper_bound_s": proof.flown,
        "lower_bound_s": proof.time,
        "gap": proof.gap,
        "verdict": proof.verdict.value,
        "branches": len(proof.excluded),
        "windings": len(windings(proof.scenario, proof.tolerance, proof.time)),
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
        usual = None if many else prove(name, time_budget=BUDGET)
        tight = prove(name, max_gap=CLOSE, time_budget=LONG_BUDGET if many else BUDGET)
        row = proof_row(tight)
        row |= {"gap_asked": CLOSE, "to_0.1%_s": usual.wall_time if usual and usual.gap <= 1e-3 else None}
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


def steps(quick: bool, advance: Advance) -> list[Row]:
    """Is K* of each named scenario proven, and does its flight replay in both environments?"""
    names = ["horizontal-3"] if quick else list(SCENARIOS)
    rows = []
    for i, name in enumerate(names):
        begun = time.perf_counter()
        many = len(SCENARIOS[name].hoops) > 1
        answer = optimal.fewest_steps(name, time_budget=LONG_BUDGET / 2 if many else BUDGET)
        row = steps_row(answer) | {"wall_time_s": time.perf_counter() - begun}
        rows.append(row | {"replays_scalar": replays(answer), "replays_batched": replays_batched(answer)})
        advance(i + 1, len(names))
    return rows


def steps_row(answer: FewestSteps) -> Row:
    """Return the answer of `fewest_steps` as a row."""
    return {
        "scenario": answer.scenario.name,
        "k_star": answer.steps,
        "lower_bound": answer.lower_bound,
        "gap_steps": answer.steps - answer.lower_bound,
        "proven": answer.proven,
        "winding": answer.winding,
        "tolerance_used": answer.tolerance_used,
        "status": answer.status.value,
        "reason": answer.reason,
    }


def replays(answer: FewestSteps) -> bool:
    """Return whether the actions end in the goal at exactly the last step of `gym.make`'s environment."""
    env = gym.make("FlatQuad-v0", scenario=answer.scenario)
    env.reset(seed=0)
    ends = []
    for action in answer.actions:
        *_, terminated, truncated, info = env.step(action)
        ends.append(terminated or truncated)
    return ends == [False] * (len(ends) - 1) + [True] and info["is_success"]


def replays_batched(answer: FewestSteps) -> bool:
    """Return the same for two copies in the batched environment."""
    envs = FlatQuadVectorEnv(2, scenario=answer.scenario)
    envs.reset(seed=0)
    ends = []
    for action in answer.actions:
        _, _, terminated, truncated, info = envs.step(np.stack([action, action]))
        ends.append(terminated | truncated)
    return not np.any(ends[:-1]) and bool(np.all(ends[-1])) and bool(np.all(info["is_success"]))


def goal_steps(quick: bool, advance: Advance) -> list[Row]:
    """Of how many uniform goals is K* proven, and how many steps are open for the others? The last row is a total."""
    generator = np.random.default_rng(11)
    tasks = [(uniform_goal(generator, i),) for i in range(2 if quick else STEPPED)]
    rows = in_parallel(goal_step, tasks, advance)
    gaps = [row["gap_steps"] for row in rows]
    total = {"goals": len(rows), "proven": sum(row["proven"] for row in rows), "gap_steps_worst": max(gaps)}
    return [
        *rows,
        {"scenario": "all", **total, "wall_time_median_s": statistics.median(r["wall_time_s"] for r in rows)},
    ]


def goal_step(goal: Scenario) -> Row:
    """Return the row of one goal."""
    begun = time.perf_counter()
    answer = optimal.fewest_steps(goal, time_budget=20.0)
    row = steps_row(answer) | {"goal_m": list(goal.goal), "wall_time_s": time.perf_counter() - begun}
    return row | {"replays_scalar": replays(answer)}


def broken(_: bool, advance: Advance) -> list[Row]:
    """Does each kind of broken flight violate its own field of the certificate, and only the true one pass?"""
    names = ("true", *BREAKS)
    rows = []
    for i, name in enumerate(names):
        scenario = SCENARIOS["hoop"] if name == "hoop_clearance" else SCENARIOS["ground-6"]
        flight = optimal.solve(scenario, max_gap=None).trajectory
        assert isinstance(flight, Trajectory)
        certificate = certify(*BREAKS[name](flight, scenario)) if name != "true" else certify(flight, scenario)
        values = {field.name: getattr(certificate, field.name) for field in fields(Certificate)}
        rows.append(
            {"broken": name, "scenario": scenario.name, "field": values.get(name), "holds": certificate.holds()}
        )
        advance(i + 1, len(names))
    return rows


def _weaker_vehicle(flight: Trajectory, scenario: Scenario) -> tuple[Trajectory, Scenario]:
    weaker = replace(scenario.quadrotor, thrust_max=scenario.quadrotor.thrust_max * (1 - 1e-8))
    return flight, replace(scenario, quadrotor=weaker)


def _lower_ceiling(flight: Trajectory, scenario: Scenario) -> tuple[Trajectory, Scenario]:
    top = float(flight.state(np.linspace(0, flight.duration, 4001))[:, 1].max())
    return flight, replace(scenario, ceiling=top - 1e-6)


def _moved_state(flight: Trajectory, scenario: Scenario) -> tuple[Trajectory, Scenario]:
    states = flight.states.copy()
    states[len(states) // 2, 0] += 1e-5
    return replace(flight, states=states), scenario


def _faster_motion(flight: Trajectory, scenario: Scenario) -> tuple[Trajectory, Scenario]:
    return replace(flight, breakpoints=flight.breakpoints * 0.8), scenario


def _moved_goal(flight: Trajectory, scenario: Scenario) -> tuple[Trajectory, Scenario]:
    return flight, replace(scenario, goal=(scenario.goal[0] + 1e-5, scenario.goal[1]))


def _narrower_hoop(flight: Trajectory, scenario: Scenario) -> tuple[Trajectory, Scenario]:
    hoop = scenario.hoops[0]
    aside = float(certify(flight, scenario).hoop_clearance)
    return flight, scenario.with_diameters([hoop.diameter - 2 * (aside + 1e-6)])


BREAKS: dict[str, Callable[[Trajectory, Scenario], tuple[Trajectory, Scenario]]] = {
    "max_control_violation": _weaker_vehicle,
    "max_path_violation": _lower_ceiling,
    "replay_error": _moved_state,
    "gap": _faster_motion,
    "terminal_error": _moved_goal,
    "hoop_clearance": _narrower_hoop,
}
"""How to break a flight or to tighten its scenario, by the field of the certificate that must fail."""


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
