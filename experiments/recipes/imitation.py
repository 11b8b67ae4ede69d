"""TODO experiments/recipes/imitation.py."""

from __future__ import annotations

import time
from typing import Any

import torch
from stable_baselines3 import PPO

from agents.evaluation.checks import VALIDATION_SEED, Point
from agents.imitation.advisers import guided, regulated
from agents.imitation.cloning import CloneConfig, fit, student
from agents.imitation.dataset import Shown
from agents.imitation.dataset_aggregation import DaggerConfig, ExpertOracle, dagger
from agents.imitation.selection import BestPolicy
from experiments.recipes.lesson import RunSpec, TrainedAgent, best_known
from experiments.recipes.margins import teacher
from experiments.recipes.plans import plans
from flatgym.scenarios.scenario import Scenario


class CountingOracle:
    """An adviser that counts: the steps learners flew, and those for which it gave advice."""

    def __init__(self, adviser: ExpertOracle) -> None:
        self.adviser = adviser
        self.env_steps = self.expert_steps = 0

    def __call__(self, learner: PPO | None, number: int) -> Shown:
        """Return the advice of a round."""
        shown = self.adviser(learner, number)
        self.expert_steps += shown.asked
        self.env_steps += shown.flown
        return shown

    def note(self, point: Point) -> None:
        """Write into a point of a learning curve what it cost."""
        point.update(env_steps=self.env_steps, expert_steps=self.expert_steps)


def oracle_for(lesson: RunSpec, flights: int) -> tuple[CountingOracle, float]:
    """Return who advises, and the time the demonstrations' planning took [s].

    Args:
        lesson: what is to be flown.
        flights: of a round, on a scenario.
    """
    sizes, target = lesson.sizes, lesson.target
    if isinstance(target, Scenario):
        begun = time.perf_counter()
        adviser = regulated([teacher(target)], count=flights, seed=lesson.seed)
        return CountingOracle(adviser), time.perf_counter() - begun
    known, taken = plans(lesson, 0, sizes.planned)
    adviser = guided(known, target, count=sizes.followed, planned=sizes.corrected, seed=lesson.seed, jobs=1)
    return CountingOracle(adviser), taken


def shared_config(lesson: RunSpec, updates: int) -> dict[str, Any]:
    """Return what cloning and DAgger have in common: on a distribution the network is larger, and sees more."""
    larger = {"width": 160, "observation_scale": 6.0, "guidance": True, "batch_size": 1024} if lesson.drawn else {}
    shared = {"scenario": lesson.problem, "seed": lesson.seed, "gradient_steps": updates}
    return shared | {"eval_seed": VALIDATION_SEED, "n_eval_episodes": lesson.sizes.n_eval_episodes} | larger


def clone(lesson: RunSpec) -> TrainedAgent:
    """Behaviour cloning of an expert's flights."""
    torch.set_num_threads(1)
    config = CloneConfig(**shared_config(lesson, lesson.sizes.gradient_steps[lesson.drawn]))
    adviser, planning = oracle_for(lesson, lesson.sizes.shown)
    keeper = BestPolicy(config, watch=adviser.note)
    model = student(config)
    fit(model, adviser(None, 0), config)
    keeper.check(model)
    return TrainedAgent(model, "BC", [config], keeper.curve, 0, adviser.expert_steps, keeper.elapsed, planning)


def advised(lesson: RunSpec) -> TrainedAgent:
    """DAgger under the regulator, or under the expert that plans anew."""
    torch.set_num_threads(1)
    sizes, drawn = lesson.sizes, lesson.drawn
    shared = shared_config(lesson, sizes.round_updates[drawn])
    config = DaggerConfig(rounds=sizes.rounds[drawn], max_seconds=sizes.dagger_s, **shared)
    adviser, planning = oracle_for(lesson, sizes.shown // 2)
    keeper = BestPolicy(config, target=best_known(lesson), watch=adviser.note)
    model = dagger(student(config), adviser, config, keeper)
    spent = adviser.env_steps, adviser.expert_steps, keeper.elapsed
    return TrainedAgent(model, "DAgger", [config], keeper.curve, *spent, planning)
