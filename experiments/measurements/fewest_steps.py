"""Measurements of K*, the fewest steps: proofs, and replays in both environments.

Each function with a parameter `advance` is a section of `experiments.measurements.solvers`.
"""

from __future__ import annotations

import statistics
import time

import gymnasium as gym
import numpy as np

import optimal
from experiments.files import Row
from experiments.measurements.proofs import BUDGET
from experiments.measurements.sections import Advance, in_parallel, uniform_goal
from flatgym import SCENARIOS, Scenario
from flatgym.envs.vector import FlatQuadVectorEnv
from optimal import FewestSteps

GOALS = 200
"""Uniform goals of `goal_steps`."""
TRACK_BUDGET = 40.0
"""Time budget of the proof with several hoops [s]. Search and proof of 12 hoops take less than a minute."""


def steps(quick: bool, advance: Advance) -> list[Row]:
    """Is K* of each named scenario proven, and does its flight replay in both environments?"""
    names = ["horizontal-3"] if quick else list(SCENARIOS)
    rows = []
    for i, name in enumerate(names):
        begun = time.perf_counter()
        many = len(SCENARIOS[name].hoops) > 1
        answer = optimal.fewest_steps(name, time_budget=TRACK_BUDGET if many else BUDGET)
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
    tasks = [(uniform_goal(generator, i),) for i in range(2 if quick else GOALS)]
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
