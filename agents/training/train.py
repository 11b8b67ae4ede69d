"""Train on one scenario or on a distribution: a flat configuration in, the best policy and its learning curve out.

What makes it learn (plain resets learn nothing): starts flown backwards from the goal, a tolerance
that tightens to the true one, a discount that rises, and, with PPO, a learning rate that follows a wanted
Kullback-Leibler divergence between updates. Now and then the deterministic policy flies the true problem;
the policy that succeeded most often, and then in fewest steps, is the one that is kept.

    train(PPOConfig(scenario="hoop", folder="runs/hoop"))                 # 73 steps after 5 million
    train(PPOConfig(scenario="hoop", policy="cloned.zip", tolerance=1.0)) # from a policy that flies already
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import configure

from agents import policies
from agents.evaluation.checks import Point
from agents.training import checkpoints
from agents.training.configs import Config, PPOConfig
from agents.training.models import build
from agents.training.progress import Progress, curve_file, model_file, read_curve
from agents.training.schedules import PPOCallback, TrainingCallback
from flatgym.extras import require
from flatgym.files import write_text
from optimal.discrete.fewest_steps import FewestSteps

__all__ = ["Training", "build", "load", "read_curve", "train"]

EPISODES_LOGGED = 100
"""Episodes between two rows of the log of an algorithm with a replay buffer."""


@dataclass(frozen=True)
class Training:
    """What a training gave.

    Attributes:
        config: what it was asked.
        model: file of the best policy, or of the last where none ever succeeded.
        curve: one point a check: env_steps, wall_time_s, outcome (of most flights), success_rate, and steps, the mean
            over the flights that succeeded, or over all where none did.
        best: the point of the policy that was kept; None where none ever succeeded.
        env_steps: environment steps flown.
        wall_time_s: wall time [s].
    """

    config: Config
    model: Path
    curve: list[Point]
    best: Point | None
    env_steps: int
    wall_time_s: float


def train(
    config: Config,
    optimum: FewestSteps | int | None = None,
    resume: bool = False,
    watch: Callable[[Point], Any] = lambda _: None,
) -> Training:
    """Train, and keep the best deterministic policy met on the way.

    The same configuration gives the same policy, bit for bit and however often it was killed and resumed, unless it
    is so slow that the clock must lead its schedules (`schedules.LATE`) or end it.

    Args:
        config: everything the training depends on. Its `policy`, where it is a file, is trusted as in `policies.load`.
        optimum: K*, if known: training on a scenario stops when the policy flies in K* steps.
        resume: go on from the checkpoint in `config.folder`, if there is one.
        watch: is told each point of the learning curve.

    Returns:
        The model's file and the learning curve; `config.folder` holds both, the configuration, the checkpoint, and
        the logs of Stable-Baselines3.

    Raises:
        ValueError: for a damaged checkpoint, or one of another configuration.
        OSError: where something cannot be written; what was written before is intact.
    """
    torch.set_num_threads(1)  # small networks: a second thread costs more than it gives
    model, progress = build(config), Progress(rate=config.learning_rate)
    if resume and checkpoints.checkpoint_file(config).exists():
        progress = checkpoints.restore(config, model)
    else:
        checkpoints.checkpoint_file(config).unlink(missing_ok=True)
    write_text(Path(config.folder) / "config.json", config.to_json() + "\n")
    write_text(curve_file(config), "".join(json.dumps(point) + "\n" for point in progress.curve))
    target = optimum.steps if isinstance(optimum, FewestSteps) else optimum
    kind = PPOCallback if isinstance(config, PPOConfig) else TrainingCallback
    schedules = kind(config, -np.inf if target is None else target, progress, watch)
    _set_logger(config, model)
    try:
        _learn(model, schedules)
    finally:
        model.logger.close()
    return Training(config, model_file(config), progress.curve, progress.best, model.num_timesteps, schedules.elapsed)


def _set_logger(config: Config, model: BaseAlgorithm) -> None:
    """Log as SB3 does, each session of a training in a folder of its own."""
    if config.tensorboard:
        require("tensorboard", "tensorboard")
    folder = Path(config.folder) / "logs" / f"from-{model.num_timesteps}"
    model.set_logger(configure(str(folder), ["csv", "tensorboard"] if config.tensorboard else ["csv"]))


def _learn(model: BaseAlgorithm, schedules: TrainingCallback) -> None:
    """Train chapter by chapter, a checkpoint after each."""
    config, progress = schedules.config, schedules.progress
    chapter_steps = config.checkpoint_every * config.rollout_steps * config.num_envs
    schedules.begin(model)
    if config.policy and not progress.curve:
        schedules.check()
    while model.num_timesteps < config.env_steps and not schedules.over:
        model.set_random_seed(checkpoints.chapter_seed(config, progress.chapter))
        model._last_obs = None  # all flights begin anew
        schedules.change()
        model.learn(
            min(chapter_steps, config.env_steps - model.num_timesteps),
            callback=schedules,
            log_interval=1 if isinstance(config, PPOConfig) else EPISODES_LOGGED,
            reset_num_timesteps=False,
        )
        progress.chapter += 1
        schedules.settle()
        checkpoints.write(config, model, replace(progress, seconds=schedules.elapsed))
    schedules.change()
    schedules.check()
    if progress.best is None:
        policies.save(model, model_file(config), config.scenario)


def load(model: str | Path) -> BaseAlgorithm:
    """Return a policy that was trained here. Loading it executes code in the file: load only your own."""
    return policies.load(model, trust=True)
