"""Imitation recipes: behaviour cloning and DAgger, with the expert oracle of the task.

On a scenario the oracle is an LQR around one optimal flight with margins. On a distribution it is
`agents.imitation.oracles.combined_oracle`, which uses the optimal flights of sampled scenarios.
"""

from __future__ import annotations

import time
from typing import Any

from stable_baselines3 import PPO

from agents.evaluation.validation import VALIDATION_SEED, Point
from agents.imitation.cloning import CloneConfig, fit, untrained_policy
from agents.imitation.dataset import ExpertData
from agents.imitation.dataset_aggregation import DaggerConfig, ExpertOracle, dagger
from agents.imitation.oracles import combined_oracle, lqr_oracle
from agents.imitation.selection import BestPolicy
from agents.training.threads import torch_threads
from experiments.recipes.margins import robust_flight
from experiments.recipes.plans import plan_flights
from experiments.recipes.run_spec import RunSpec, TrainedAgent
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import Problem
from flatgym.scenarios.scenario import Scenario

DISTRIBUTION_NETWORK: dict[str, Any] = {"width": 160, "observation_scale": 6.0, "guidance": True, "batch_size": 1024}
"""Network and batch for a distribution: larger than for a scenario, with predicted miss distances as inputs."""

BINS = (21, 81)
"""Bins of categorical actors: fine enough for the LQR to fly tracks with actions rounded to these levels."""
NOT_ROUNDED = {"ladder"}
"""Tracks that the LQR does not fly with rounded actions, however fine."""


def bins_of(problem: Problem) -> tuple[int, int] | None:
    """Return the bins of the actor that imitates: BINS on tracks, None (the squared error) on all other tasks.

    The squared error averages the labels on both sides of a switch. Over the hundreds of steps of a track the errors
    add up to a missed hoop.
    """
    is_track = isinstance(problem, Scenario) and len(problem.hoops) > 1
    return BINS if is_track and catalogue.label(problem) not in NOT_ROUNDED else None


class CountingOracle:
    """An expert oracle that counts environment steps and expert labels."""

    def __init__(self, oracle: ExpertOracle) -> None:
        self.oracle = oracle
        self.env_steps = self.expert_labels = 0

    def __call__(self, policy: PPO | None, number: int) -> ExpertData:
        """Return the labelled data of a round."""
        data = self.oracle(policy, number)
        self.expert_labels += data.labels
        self.env_steps += data.env_steps
        return data

    def add_cost(self, point: Point) -> None:
        """Add the counts to a point of a learning curve."""
        point.update(env_steps=self.env_steps, expert_labels=self.expert_labels)


def oracle_for(spec: RunSpec, rollouts: int) -> tuple[CountingOracle, float]:
    """Return the expert oracle of a task, and the time to plan its optimal flights [s].

    Args:
        spec: the task.
        rollouts: episodes of a round on a scenario; on a distribution the budget has them.
    """
    budget, target = spec.budget, spec.target
    if isinstance(target, Scenario):
        began = time.perf_counter()
        oracle = lqr_oracle([robust_flight(target)], count=rollouts, seed=spec.seed)
        return CountingOracle(oracle), time.perf_counter() - began
    flights, planning_s = plan_flights(spec, 0, budget.demonstrations)
    counts = {"count": budget.round_rollouts, "plan_episodes": budget.round_replans}
    return CountingOracle(combined_oracle(flights, target, **counts, seed=spec.seed, jobs=1)), planning_s


def shared_config(spec: RunSpec, gradient_steps: int) -> dict[str, Any]:
    """Return the configuration fields that behaviour cloning and DAgger have in common."""
    shared = {"scenario": spec.problem, "seed": spec.seed, "gradient_steps": gradient_steps}
    validation = {"eval_seed": VALIDATION_SEED, "n_eval_episodes": spec.budget.n_eval_episodes}
    return shared | validation | (DISTRIBUTION_NETWORK if spec.is_distribution else {})


@torch_threads()
def train_bc(spec: RunSpec, bins: tuple[int, int] | None = None) -> TrainedAgent:
    """Train by behaviour cloning of expert episodes; with bins, and on tracks, by cross-entropy."""
    config = CloneConfig(
        bins=bins or bins_of(spec.target), **shared_config(spec, spec.budget.gradient_steps[spec.is_distribution])
    )
    oracle, planning_s = oracle_for(spec, spec.budget.expert_rollouts)
    best = BestPolicy(config, on_validation=oracle.add_cost)
    model = untrained_policy(config)
    fit(model, oracle(None, 0), config)
    best.validate(model)
    return TrainedAgent(model, "BC", [config], best.curve, 0, oracle.expert_labels, best.elapsed, planning_s)


@torch_threads()
def train_dagger(spec: RunSpec, bins: tuple[int, int] | None = None) -> TrainedAgent:
    """Train by DAgger, until K* is reached on a scenario or the budget is spent; bins as in `train_bc`."""
    budget, which = spec.budget, spec.is_distribution
    shared = shared_config(spec, budget.round_gradient_steps[which])
    config = DaggerConfig(
        bins=bins or bins_of(spec.target), rounds=budget.rounds[which], max_seconds=budget.dagger_s, **shared
    )
    oracle, planning_s = oracle_for(spec, budget.expert_rollouts // 2)
    best = BestPolicy(config, target=spec.k_star, on_validation=oracle.add_cost)
    model = dagger(untrained_policy(config), oracle, config, best)
    cost = oracle.env_steps, oracle.expert_labels, best.elapsed
    return TrainedAgent(model, "DAgger", [config], best.curve, *cost, planning_s)
