"""What happens in the course of a training: schedules, checks of the deterministic policy, the end.

All that is remembered from one rollout to the next is in a `Progress`, which a checkpoint holds.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import ConstantSchedule

from agents import policies
from agents.evaluation.checks import VALIDATION_SEED, Point, outcome_of
from agents.evaluation.rollouts import fly
from agents.training.configs import Config, PPOConfig
from agents.training.curriculum import curriculum
from agents.training.progress import Progress, curve_file, model_file
from flatgym.scenarios.scenario import Scenario

PACE = 4096
"""Least environment steps between two changes of the curriculum."""
LATE = 0.1
"""Share of its time by which a training may be late before the clock leads its schedules, and chance comes in."""


class TrainingCallback(BaseCallback):
    """Runs all schedules, checks the deterministic policy, keeps the best, and stops in time.

    Args:
        config: what is trained.
        target: steps in which training has reached its end.
        progress: how far it is.
        watch: is told each point of the learning curve.
    """

    def __init__(
        self,
        config: Config,
        target: float = -np.inf,
        progress: Progress | None = None,
        watch: Callable[[Point], Any] = lambda _: None,
    ) -> None:
        super().__init__()
        self.config, self.target, self.watch = config, target, watch
        self.progress = progress or Progress(rate=config.learning_rate)
        self.curriculum = curriculum(config)
        self.changed, self.began = 0, math.inf

    @property
    def elapsed(self) -> float:
        """Wall time of training [s]."""
        return self.progress.seconds + max(0.0, time.perf_counter() - self.began)

    @property
    def done(self) -> float:
        """Share of the training that is over, in [0, 1]: by its steps, or by the clock where it runs far ahead."""
        steps, clock = self.model.num_timesteps / self.config.env_steps, self.elapsed / self.config.max_seconds
        return min(1.0, max(steps, (clock - LATE) / (1 - LATE)))

    @property
    def over(self) -> bool:
        """Whether the clock has run out or the target is reached."""
        best = self.progress.best
        reached = best is not None and best["success_rate"] == 1 and best["steps"] <= self.target
        return reached or self.elapsed >= self.config.max_seconds

    def begin(self, model: BaseAlgorithm) -> None:
        """Start the clock of a session."""
        self.init_callback(model)
        self.began = time.perf_counter()

    def settle(self) -> None:
        """Take down what a checkpoint must know."""

    def _on_step(self) -> bool:
        return not self.over

    def _on_rollout_end(self) -> None:
        if self.num_timesteps - self.changed >= PACE:
            self.change()
        self.progress.rollouts += 1
        if self.progress.rollouts % self.config.eval_every == 0:
            self.check()

    def change(self) -> None:
        """Make environments and discount what they are to be now."""
        done, self.changed = self.done, self.model.num_timesteps
        environments = self.model.get_env()
        assert environments is not None
        self.curriculum.apply(environments, done)
        first, last = self.config.gamma, self.config.gamma_end
        self.discount(first + (last - first) * min(1.0, done / 0.6))

    def discount(self, value: float) -> None:
        """Let the model discount so from now on."""
        self.model.gamma = value  # type: ignore[attr-defined]

    def check(self) -> None:
        """Fly the true problem deterministically, extend the curve, and write the policy if it is the best so far."""
        problem = self.curriculum.problem
        episodes = 1 if isinstance(problem, Scenario) else self.config.n_eval_episodes
        flights = fly(self.model, problem, episodes, VALIDATION_SEED)
        point = {"env_steps": self.model.num_timesteps, "wall_time_s": round(self.elapsed, 1)} | outcome_of(flights)
        best = self.progress.best
        self.progress.curve.append(point)
        if self.progress.best is not best:
            policies.save(self.model, model_file(self.config), self.config.scenario)
        with curve_file(self.config).open("a", encoding="utf-8") as file:
            file.write(json.dumps(point) + "\n")
        self.watch(point)


class PPOCallback(TrainingCallback):
    """Those of PPO besides: the learning rate follows the divergence, and the critic may learn first."""

    model: PPO
    config: PPOConfig

    @property
    def warmup(self) -> int:
        """Rollouts from which only the critic learns."""
        return self.config.value_warmup if self.config.policy else 0

    def _on_rollout_start(self) -> None:
        self.settle()

    def _on_rollout_end(self) -> None:
        if self.progress.rollouts > self.warmup:
            self.steer()
        self.model.lr_schedule = ConstantSchedule(self.progress.rate)
        for name, parameter in self.model.policy.named_parameters():
            of_critic = name.startswith(("value_net.", "mlp_extractor.value_net."))
            parameter.requires_grad_(of_critic or self.progress.rollouts >= self.warmup)
        super()._on_rollout_end()

    def settle(self) -> None:
        """Take down the divergence of the last update, if there was one in this session."""
        self.progress.divergence = float(self.logger.name_to_value.get("train/approx_kl", self.progress.divergence))

    def steer(self) -> None:
        """Slow down when the last update went farther than wanted, and hurry when it did not go far enough."""
        config, progress = self.config, self.progress
        wanted = config.target_kl * max(config.target_kl_end, 1 - self.done)
        if progress.divergence > 2 * wanted:
            progress.rate /= 1.5
        elif 0 < progress.divergence < wanted / 2:
            progress.rate = min(1.5 * progress.rate, config.learning_rate_max)

    def discount(self, value: float) -> None:
        """Let the model discount so from now on."""
        self.model.gamma = self.model.rollout_buffer.gamma = value
