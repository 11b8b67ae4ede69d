"""Agents that are built and not trained here: experts, controllers, and the policies that come with the package."""

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
from agents.controllers.trivial import Hover, RandomActions
from agents.policies import archive
from agents.policies.fingerprint import fingerprint
from agents.policies.policy import Policy
from experiments.recipes.margins import robust_flight, with_margins
from experiments.recipes.plans import plan_flights
from experiments.recipes.run_spec import RunSpec, TrainedAgent
from flatgym.scenarios.reference import EVALUATION_SEED
from flatgym.scenarios.scenario import Scenario
from optimal.discrete.fewest_steps import FewestSteps, fewest_steps


class PolicyPerVehicle:
    """Many policies as one: vehicle i is flown by policy i."""

    def __init__(self, policies: Sequence[Policy]) -> None:
        self.policies = policies

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions, shape (n, 2), of observations, shape (n, 19); n at most the number of policies."""
        pairs = zip(self.policies, np.asarray(observation), strict=False)
        return np.stack([policy.predict(row)[0] for policy, row in pairs]), state


def expert_policies(spec: RunSpec, kind: Callable[[FewestSteps], Policy]) -> tuple[Policy, float]:
    """Return a policy of a kind around the optimal flight of each evaluation episode, and the planning time [s]."""
    if isinstance(spec.target, Scenario):
        began = time.perf_counter()
        return kind(robust_flight(spec.target)), time.perf_counter() - began
    flights, planning_s = plan_flights(spec, EVALUATION_SEED, spec.budget.disturbed_episodes)
    return PolicyPerVehicle([kind(flight) for flight in flights]), planning_s


def expert(spec: RunSpec) -> TrainedAgent:
    """Return the LQR around an optimal flight with margins."""
    policy, planning_s = expert_policies(spec, Expert)
    return TrainedAgent(policy, "LQR about a K* flight", planning_s=planning_s)


def open_loop(spec: RunSpec) -> TrainedAgent:
    """Return the open-loop replay of the expert's flight."""
    policy, planning_s = expert_policies(spec, OpenLoop)
    return TrainedAgent(policy, "open-loop replay", planning_s=planning_s)


def expert_no_margin(spec: RunSpec) -> TrainedAgent:
    """Return the LQR around an optimal flight that may graze the rims."""
    flight = fewest_steps(spec.problem, time_budget=0.0)
    return TrainedAgent(Expert(flight), "LQR about a K* flight, no margin")


def mpc(spec: RunSpec) -> TrainedAgent:
    """Return MPC with a shrinking horizon, which plans with margins at every step."""
    assert isinstance(spec.target, Scenario)
    flight = fewest_steps(with_margins(spec.target), time_budget=0.0)
    return TrainedAgent(PolicyPerVehicle([MPC(flight) for _ in range(spec.budget.mpc_episodes)]), "MPC")


def cascaded_pd(spec: RunSpec) -> TrainedAgent:
    """Return the cascaded PD controller."""
    return TrainedAgent(CascadedPD(spec.target.quadrotor), "cascaded PD")


def hover(spec: RunSpec) -> TrainedAgent:
    """Return the agent that stands still."""
    return TrainedAgent(Hover(spec.target.quadrotor), "hover")


def random_actions(spec: RunSpec) -> TrainedAgent:
    """Return the agent that acts at random."""
    return TrainedAgent(RandomActions(spec.seed), "uniformly random actions")


def pretrained(spec: RunSpec) -> TrainedAgent:
    """Return the policy that comes with the package, with the cost that its card states."""
    card = json.loads((archive.PRETRAINED / f"{spec.problem}.json").read_text(encoding="utf-8"))
    score, policy = card["score"], policies.pretrained(spec.problem)
    cost = score["env_steps"] or 0, 0, score["wall_time_s"]
    file = fingerprint(archive.PRETRAINED / f"{spec.problem}.zip")
    return TrainedAgent(policy, score["algorithm"], (), (), *cost, fingerprint=file)
