"""Model selection for imitation learning: validate after each fit and keep the best weights."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import torch
from stable_baselines3 import PPO

from agents.evaluation.validation import Point, Validation
from agents.imitation.cloning import CloneConfig


class BestPolicy:
    """Validates a policy, extends its learning curve, and stores the weights of the best one.

    Args:
        config: gives the scenario and the validation episodes.
        target: steps at which the policy needs no improvement.
        on_validation: called with each point of the learning curve.

    Attributes:
        env_steps: environment steps of the policy so far; the caller adds them.
    """

    def __init__(
        self, config: CloneConfig, target: float = 0.0, on_validation: Callable[[Point], Any] = lambda _: None
    ) -> None:
        self.validation = Validation(config.scenario, config.eval_seed, config.n_eval_episodes, target)
        self.on_validation, self.started = on_validation, time.perf_counter()
        self.weights: dict[str, torch.Tensor] = {}
        self.env_steps = 0

    @property
    def curve(self) -> list[Point]:
        """The learning curve, one point a validation."""
        return self.validation.curve

    @property
    def elapsed(self) -> float:
        """Wall time since construction [s]."""
        return time.perf_counter() - self.started

    @property
    def target_reached(self) -> bool:
        """Whether the best policy needs no improvement."""
        return self.validation.target_reached

    def validate(self, model: PPO) -> Point:
        """Validate the policy, store its weights if it is the best, and return the new point of the curve."""
        if self.validation.run(model, self.env_steps, self.elapsed):
            self.weights = {name: value.clone() for name, value in model.policy.state_dict().items()}
        point = self.curve[-1]
        self.on_validation(point)
        return point

    def load_best(self, model: PPO) -> PPO:
        """Load the weights of the best validation into the model, and return it."""
        model.policy.load_state_dict(self.weights)
        return model
