"""Callbacks of a training: curriculum and schedules, validation, and the end of the training.

The state that is carried from one rollout to the next is a `Progress`, which a checkpoint stores.
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
from agents.evaluation.validation import Point, Validation
from agents.training.configs import Config, OffPolicyConfig, PPOConfig
from agents.training.curriculum import curriculum
from agents.training.progress import Progress, curve_file, model_file
from agents.training.self_imitation import Flight, FlightRecorder
from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario

CURRICULUM_STEPS = 4096
"""Smallest number of environment steps between two updates of the curriculum."""
CLOCK_SLACK = 0.1
"""Share of `max_seconds` by which a training may be slow before the clock leads the schedules.

Beyond it the result depends on the speed of the machine.
"""
LOGGED = ("success_rate", "steps", "hoops_passed", "way_left")
"""Values of a validation that are logged; the last two tell apart policies that do not succeed yet."""
FINAL_FITS, FINAL_STEPS = 40, 50
"""Most fits to the best flight after a training, and gradient steps of each."""
GAMMA_SHARE = 0.6
"""Share of the training after which the discount is `gamma_end`."""


class TrainingCallback(BaseCallback):
    """Applies the curriculum, validates the policy, saves the best one, and stops the training.

    Args:
        config: configuration of the training.
        target: steps at which the policy needs no improvement.
        progress: state of a resumed training.
        on_validation: called with each point of the learning curve.
    """

    def __init__(
        self,
        config: Config,
        target: float = -np.inf,
        progress: Progress | None = None,
        on_validation: Callable[[Point], Any] = lambda _: None,
    ) -> None:
        super().__init__()
        self.config, self.on_validation = config, on_validation
        self.progress = progress or Progress(learning_rate=config.learning_rate)
        self.curriculum = curriculum(config)
        self.validation = Validation(
            self.curriculum.problem, episodes=config.n_eval_episodes, target=target, curve=self.progress.curve
        )
        self.updated_at, self.started_at = 0, math.inf

    @property
    def elapsed(self) -> float:
        """Wall time of the training over all sessions [s]."""
        return self.progress.seconds + max(0.0, time.perf_counter() - self.started_at)

    @property
    def done(self) -> float:
        """Completed share of the training in [0, 1]: by environment steps, or by the clock if it is far ahead."""
        steps, clock = self.model.num_timesteps / self.config.env_steps, self.elapsed / self.config.max_seconds
        return min(1.0, max(steps, (clock - CLOCK_SLACK) / (1 - CLOCK_SLACK)))

    @property
    def finished(self) -> bool:
        """Whether the time is up or the target is reached."""
        return self.validation.target_reached or self.elapsed >= self.config.max_seconds

    def start(self, model: BaseAlgorithm) -> None:
        """Attach the model and start the clock of a session."""
        self.init_callback(model)
        self.started_at = time.perf_counter()

    def record_kl(self) -> None:
        """Record the divergence of the last update before a checkpoint; PPO only."""

    def finish(self) -> None:
        """Validate the policy at the end of the training."""
        self.apply_curriculum()
        self.validate()

    def _on_step(self) -> bool:
        return not self.finished

    def _on_rollout_end(self) -> None:
        if self.num_timesteps - self.updated_at >= CURRICULUM_STEPS:
            self.apply_curriculum()
        self.progress.rollouts += 1
        if self.progress.rollouts % self.config.eval_every == 0:
            self.validate()

    def apply_curriculum(self) -> None:
        """Set environments and discount for the completed share of the training."""
        done, self.updated_at = self.done, self.model.num_timesteps
        environments = self.model.get_env()
        assert environments is not None
        self.curriculum.apply(environments, done)
        first, last = self.config.gamma, self.config.gamma_end
        self.set_gamma(first + (last - first) * min(1.0, done / GAMMA_SHARE))
        if isinstance(self.config, OffPolicyConfig):
            rate = 1 - (1 - self.config.learning_rate_end) * done
            self.model.lr_schedule = ConstantSchedule(self.config.learning_rate * rate)

    def set_gamma(self, value: float) -> None:
        """Set the discount of the model, and of its buffer where it has one: of a rollout, or of n-step returns."""
        self.model.gamma = value  # type: ignore[attr-defined]
        for name in ("rollout_buffer", "replay_buffer"):
            buffer: Any = getattr(self.model, name, None)
            if hasattr(buffer, "gamma"):
                buffer.gamma = value

    def validate(self) -> None:
        """Validate the policy, extend the curve, and save the policy if it is the best and has succeeded."""
        improved = self.validation.run(self.model, self.model.num_timesteps, self.elapsed)
        point = self.validation.curve[-1]
        for name in LOGGED:
            self.logger.record(f"validation/{name}", point[name])
        if improved and point["success_rate"] > 0:
            policies.save(self.model, model_file(self.config), self.config.scenario)
        with curve_file(self.config).open("a", encoding="utf-8") as file:
            file.write(json.dumps(point) + "\n")
        self.on_validation(point)


class PPOCallback(TrainingCallback):
    """Adapts the learning rate of PPO to the divergence of its updates, trains the critic alone at first, and imitates.

    Self-imitation (`agents.training.self_imitation`) begins when the tolerance is the true one.
    """

    model: PPO
    config: PPOConfig
    recorder: FlightRecorder | None = None
    """Recorder of the flights of a scenario; None without self-imitation."""

    @property
    def warmup(self) -> int:
        """Rollouts that train the critic only."""
        return self.config.value_warmup if self.config.policy else 0

    @property
    def flight(self) -> Flight | None:
        """The best flight of the training, None without self-imitation or success."""
        problem, stored = self.curriculum.problem, self.progress.flight
        return None if stored is None or not isinstance(problem, Scenario) else Flight(problem, *stored)

    def finish(self) -> None:
        """Validate the policy; after the warmup, fit it to the best flight until it flies in as few steps."""
        super().finish()
        if (flight := self.flight) is None or self.progress.rollouts <= self.warmup:
            return
        for group in self.model.policy.optimizer.param_groups:
            group["lr"] = self.config.learning_rate
        for _ in range(FINAL_FITS):
            if (best := self.progress.best) is not None and best["steps"] <= len(flight.actions):
                break
            flight.fit(self.model, FINAL_STEPS)
            self.validate()

    def _on_training_start(self) -> None:
        self.recorder = None  # all episodes have been reset

    def _on_rollout_start(self) -> None:
        self.record_kl()
        problem = self.curriculum.problem
        if self.recorder is None:
            if self.config.self_imitation and isinstance(problem, Scenario) and self.is_tight(problem):
                self.recorder = FlightRecorder(problem, self._states(), self.flight)
        elif self.progress.rollouts > self.warmup:
            self.recorder.imitate(self.model, self.config.self_imitation)

    def is_tight(self, problem: Scenario) -> bool:
        """Return whether the tolerance of the environments is the true one."""
        tight: bool = self.training_env.get_attr("scenario")[0] == problem
        return tight

    def _on_step(self) -> bool:
        if self.recorder is not None:
            actions, dones, infos = (self.locals[name] for name in ("clipped_actions", "dones", "infos"))
            self.recorder.step(actions, self._states(), dones, infos)
        return super()._on_step()

    def _states(self) -> Array:
        states: Array = self.training_env.unwrapped.arrays["state"]  # type: ignore[attr-defined]
        return states

    def apply_curriculum(self) -> None:
        """Set environments, discount and entropy weight for the completed share of the training."""
        super().apply_curriculum()
        self.model.ent_coef = self.config.ent_coef * (1 - self.done)

    def _on_rollout_end(self) -> None:
        if self.recorder is not None and (best := self.recorder.best) is not None:
            self.progress.flight = best.actions, best.excess
        if self.progress.rollouts > self.warmup:
            self.adapt_learning_rate()
        self.model.lr_schedule = ConstantSchedule(self.progress.learning_rate)
        for name, parameter in self.model.policy.named_parameters():
            of_critic = name.startswith(("value_net.", "mlp_extractor.value_net."))
            parameter.requires_grad_(of_critic or self.progress.rollouts >= self.warmup)
        super()._on_rollout_end()

    def record_kl(self) -> None:
        """Record the divergence of the last update, if this session had one."""
        self.progress.approx_kl = float(self.logger.name_to_value.get("train/approx_kl", self.progress.approx_kl))

    def adapt_learning_rate(self) -> None:
        """Divide the learning rate by 1.5 if the divergence is above twice its target; multiply it below half."""
        config, progress = self.config, self.progress
        target_kl = config.target_kl * max(config.target_kl_end, 1 - self.done)
        if progress.approx_kl > 2 * target_kl:
            progress.learning_rate /= 1.5
        elif 0 < progress.approx_kl < target_kl / 2:
            progress.learning_rate = min(1.5 * progress.learning_rate, config.learning_rate_max)
