"""TODO experiments/benchmark/conditions.py."""

from __future__ import annotations

import time
from collections import Counter

from agents.evaluation.rollouts import CALM as NO_DISTURBANCES
from agents.evaluation.rollouts import fly
from agents.evaluation.scores import flight_rows
from agents.policies.policy import Policy
from experiments.files import Row
from experiments.recipes.lesson import RunSpec
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.reference import EVALUATION_SEED

CALM = "calm"
"""The condition without disturbances."""
CONDITIONS = {
    CALM: NO_DISTURBANCES,
    "wind": Disturbances(wind=0.5),
    "mass": Disturbances(mass=0.05),
    "delay": Disturbances(action_delay=1),
    "together": Disturbances(wind=0.25, mass=0.025, action_delay=1),
}
"""What stands against the vehicle: nothing, one disturbance, or wind and mass at half strength with the delay."""


def flown(policy: Policy, lesson: RunSpec, agent: str) -> Row:
    """Let a policy fly under all conditions.

    Returns:
        The "flights" of each condition, with outcomes and each flight's steps, None where it failed; and on a scenario
        the "actions" of the undisturbed one.
    """
    found = {}
    for name, disturbances in CONDITIONS.items():
        begun = time.perf_counter()
        episodes = flights_of(lesson, agent, name == "calm")
        rows = flight_rows(policy, lesson.problem, episodes, EVALUATION_SEED, disturbances=disturbances)
        reached = rows["outcome"] == "goal"
        found[name] = {
            "outcomes": dict(Counter(rows["outcome"])),
            "steps": [int(steps) if there else None for steps, there in zip(rows["steps"], reached, strict=True)],
            "seconds": round(time.perf_counter() - begun, 2),
        }
    if lesson.drawn:
        return {"flights": found}
    actions = fly(policy, lesson.problem, 1, EVALUATION_SEED).actions[0]
    return {"flights": found, "actions": [[float(str(value)) for value in row] for row in actions]}  # as short as exact


def flights_of(lesson: RunSpec, agent: str, calm: bool) -> int:
    """Return how many flights an agent flies: one tells all of a deterministic policy on an undisturbed scenario."""
    sizes = lesson.sizes
    if calm and not lesson.drawn:
        return 1
    if agent == "replanner":
        return sizes.replanned
    return sizes.goals if calm and agent not in ("expert", "tape") else sizes.disturbed
