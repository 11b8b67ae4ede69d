"""TODO experiments/recipes/baselines.py."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import policies
from agents.controllers.cascaded_pd import CascadedPD
from agents.controllers.mpc import MPC
from agents.controllers.tracking import Expert, OpenLoop
from agents.policies import archive
from agents.policies.policy import Policy
from experiments.recipes.lesson import RunSpec, TrainedAgent
from experiments.recipes.margins import narrower, teacher
from experiments.recipes.plans import plans
from flatgym.scenarios.reference import EVALUATION_SEED
from flatgym.scenarios.scenario import Scenario
from optimal.discrete.fewest_steps import FewestSteps, fewest_steps


class PolicyPerVehicle:
    """Many policies as one: vehicle i is flown by policy i."""

    def __init__(self, expert_policies: Sequence[Policy]) -> None:
        self.expert_policies = expert_policies

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return an action, shape (n, 2), for each vehicle's observation, shape (n, 19); n at most the pilots'."""
        pairs = zip(self.expert_policies, np.asarray(observation), strict=False)
        return np.stack([pilot.predict(seen)[0] for pilot, seen in pairs]), state


def expert_policies(lesson: RunSpec, kind: Callable[[FewestSteps], Policy]) -> tuple[Policy, float]:
    """Return a policy of a kind for each flight of a score, and the time the planning took [s]."""
    if isinstance(lesson.target, Scenario):
        begun = time.perf_counter()
        return kind(teacher(lesson.target)), time.perf_counter() - begun
    flights, taken = plans(lesson, EVALUATION_SEED, lesson.sizes.disturbed)
    return PolicyPerVehicle([kind(flight) for flight in flights]), taken


def expert(lesson: RunSpec) -> TrainedAgent:
    """The regulator about an optimal flight."""
    policy, taken = expert_policies(lesson, Expert)
    return TrainedAgent(policy, "LQR about a K* flight", planning_s=taken)


def tape(lesson: RunSpec) -> TrainedAgent:
    """The same flight replayed open loop."""
    policy, taken = expert_policies(lesson, OpenLoop)
    return TrainedAgent(policy, "open-loop replay", planning_s=taken)


def grazing(lesson: RunSpec) -> TrainedAgent:
    """The regulator about a flight that passes the rim with nothing to spare."""
    flight = fewest_steps(lesson.problem, time_budget=0.0)
    return TrainedAgent(Expert(flight), "LQR about a K* flight at the rim")


def replanner(lesson: RunSpec) -> TrainedAgent:
    """The expert that plans anew at every step, through the narrower hoop."""
    assert isinstance(lesson.target, Scenario)
    flight = fewest_steps(narrower(lesson.target), time_budget=0.0)
    return TrainedAgent(
        PolicyPerVehicle([MPC(flight) for _ in range(lesson.sizes.replanned)]), "replanning at every step"
    )


def cascade(lesson: RunSpec) -> TrainedAgent:
    """The cascaded PD controller."""
    return TrainedAgent(CascadedPD(lesson.target.quadrotor), "cascaded PD")


def pretrained(lesson: RunSpec) -> TrainedAgent:
    """The policy that came with the package; its card says what it cost."""
    card = json.loads((archive.PRETRAINED / f"{lesson.problem}.json").read_text(encoding="utf-8"))
    score = card["score"]
    spent = score["env_steps"] or 0, 0, score["wall_time_s"]
    return TrainedAgent(policies.pretrained(lesson.problem), score["algorithm"], (), (), *spent)
