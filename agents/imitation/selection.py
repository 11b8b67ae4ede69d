"""TODO agents/imitation/selection.py."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import torch
from stable_baselines3 import PPO

from agents.evaluation.checks import Point, outcome_of, rank
from agents.evaluation.rollouts import fly
from agents.imitation.cloning import CloneConfig
from flatgym.scenarios import catalogue
from flatgym.scenarios.scenario import Scenario


class BestPolicy:
    """Checks a policy now and then, extends its learning curve, and remembers the best.

    Args:
        config: what is flown to check.
        target: success in so few steps is the best there is.
        watch: is told each point.
    """

    def __init__(
        self, config: CloneConfig, target: float = 0.0, watch: Callable[[Point], Any] = lambda _: None
    ) -> None:
        self.config, self.target, self.watch, self.began = config, target, watch, time.perf_counter()
        self.episodes = 1 if isinstance(catalogue.problem(config.scenario), Scenario) else config.n_eval_episodes
        self.curve: list[Point] = []
        self.best: dict[str, torch.Tensor] = {}
        self.env_steps = 0

    @property
    def elapsed(self) -> float:
        """Wall time since the keeper was made [s]."""
        return time.perf_counter() - self.began

    @property
    def satisfied(self) -> bool:
        """Whether the best policy needs no improvement."""
        return any(point["success_rate"] == 1 and point["steps"] <= self.target for point in self.curve)

    def check(self, model: PPO) -> Point:
        """Fly the policy deterministically, and return the new point of the curve."""
        flights = fly(model, self.config.scenario, self.episodes, self.config.eval_seed)
        point = {"env_steps": self.env_steps, "wall_time_s": round(self.elapsed, 1), **outcome_of(flights)}
        if all(rank(point) > rank(other) for other in self.curve):
            self.best = {name: value.clone() for name, value in model.policy.state_dict().items()}
        self.curve.append(point)
        self.watch(point)
        return point

    def restore(self, model: PPO) -> PPO:
        """Give the model the weights of the best check."""
        model.policy.load_state_dict(self.best)
        return model
