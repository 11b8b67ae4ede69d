"""Train on a scenario or a distribution: a flat configuration in, the best policy and its learning curve out.

    train(PPOConfig(scenario="hoop", folder="runs/hoop"))                 # 70 steps after 3.2 million
    train(PPOConfig(scenario="hoop", policy="cloned.zip", tolerance=1.0)) # fine-tunes an existing policy

Training from plain resets does not learn. It takes start states generated backwards from the goal, a tolerance that
tightens to the true one, a discount that rises, and, for PPO, a learning rate adapted to a target Kullback-Leibler
divergence of the updates. The deterministic policy is validated on the true problem from time to time. The policy with
the highest success rate, and among these with the fewest steps, is stored.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger, make_output_format

from agents import policies
from agents.evaluation.validation import Point
from agents.training import checkpoints
from agents.training.callbacks import PPOCallback, TrainingCallback
from agents.training.configs import Config, PPOConfig
from agents.training.models import build
from agents.training.progress import Progress, curve_file, model_file
from agents.training.threads import torch_threads
from flatgym.extras import require
from flatgym.files import write_text
from optimal.discrete.fewest_steps import FewestSteps

EPISODES_LOGGED = 100
"""Episodes between two log rows of an off-policy algorithm."""


@dataclass(frozen=True)
class Training:
    """Result of a training.

    Attributes:
        config: its configuration.
        model: file of the best policy, or of the last if none succeeded.
        curve: one point a validation: env_steps, wall_time_s, outcome (the most frequent), success_rate, and steps,
            the mean over the successful episodes, or over all if none succeeded; also hoops_passed and way_left, see
            `agents.evaluation.validation.statistics`.
        best: the point of the stored policy; None if none succeeded.
        env_steps: environment steps.
        wall_time_s: wall time [s].
    """

    config: Config
    model: Path
    curve: list[Point]
    best: Point | None
    env_steps: int
    wall_time_s: float


@torch_threads()
def train(
    config: Config,
    optimum: FewestSteps | int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    on_validation: Callable[[Point], Any] = lambda _: None,
) -> Training:
    """Train, and store the best deterministic policy.

    The same configuration gives the same policy bit for bit, with or without interruptions, unless the machine is so
    slow that the clock leads the schedules (`callbacks.CLOCK_SLACK`) or ends the training.

    Args:
        config: everything the training depends on. A `policy` file is trusted as in `policies.load`.
        optimum: K*, if known: training on a scenario stops when the policy needs K* steps.
        resume: continue from the checkpoint in `config.folder`, if there is one. More `env_steps` than before prolong
            the training; its schedules then run over the new total.
        overwrite: replace an earlier training in `config.folder`.
        on_validation: called with each point of the learning curve.

    Returns:
        The model's file and the learning curve. `config.folder` holds both, the configuration, the checkpoint, and
        the logs of Stable-Baselines3.

    Raises:
        ValueError: for a damaged checkpoint, or one of another configuration; or if the folder holds an earlier
            training and neither `resume` nor `overwrite` is given.
        OSError: if a file cannot be written; earlier files stay intact.
    """
    _check_folder(config, resume or overwrite)
    model, progress = build(config), Progress(learning_rate=config.learning_rate)
    if resume and checkpoints.checkpoint_file(config).exists():
        progress = checkpoints.restore(config, model)
    else:
        checkpoints.checkpoint_file(config).unlink(missing_ok=True)
    write_text(Path(config.folder) / "config.json", config.to_json() + "\n")
    write_text(curve_file(config), "".join(json.dumps(point) + "\n" for point in progress.curve))
    target = optimum.steps if isinstance(optimum, FewestSteps) else optimum
    kind = PPOCallback if isinstance(config, PPOConfig) else TrainingCallback
    callback = kind(config, -np.inf if target is None else target, progress, on_validation)
    _set_logger(config, model)
    try:
        _learn(model, callback)
    finally:
        model.logger.close()
    return Training(config, model_file(config), progress.curve, progress.best, model.num_timesteps, callback.elapsed)


def _check_folder(config: Config, may_write: bool) -> None:
    """Raise a ValueError if the folder holds a training that must not be replaced."""
    held = [file.name for file in (model_file(config), checkpoints.checkpoint_file(config)) if file.exists()]
    if held and not may_write:
        raise ValueError(
            f"{config.folder} holds {' and '.join(held)} of an earlier training: continue it with --resume "
            "(resume=True), replace it with --overwrite (overwrite=True), or name another --folder"
        )


def _set_logger(config: Config, model: BaseAlgorithm) -> None:
    """Set up SB3's logger, with a folder for each session."""
    if config.tensorboard:
        require("tensorboard", "tensorboard")
    folder = Path(config.folder) / "logs" / f"from-{model.num_timesteps}"
    folder.mkdir(parents=True, exist_ok=True)
    formats = [make_output_format("csv", str(folder))]
    if config.tensorboard:
        own = Path(config.tensorboard) / Path(config.folder).resolve().name
        formats.append(make_output_format("tensorboard", str(own)))
    model.set_logger(Logger(str(folder), formats))


def _learn(model: BaseAlgorithm, callback: TrainingCallback) -> None:
    """Train segment by segment, with a checkpoint after each."""
    config, progress = callback.config, callback.progress
    segment_steps = config.checkpoint_every * config.rollout_steps * config.num_envs
    environments = model.get_env()
    assert environments is not None
    callback.start(model)
    if config.policy and not progress.curve:
        callback.validate()
    while model.num_timesteps < config.env_steps and not callback.finished:
        seed = checkpoints.segment_seed(config, progress.segment)
        model.set_random_seed(seed)
        # The seeds of segments are spread already, and published trainings depend on them.
        environments.unwrapped.seed_exactly(seed)  # type: ignore[attr-defined]
        model._last_obs = None  # resets all episodes
        checkpoints.end_episodes(model)
        callback.apply_curriculum()
        model.learn(
            min(segment_steps, config.env_steps - model.num_timesteps),
            callback=callback,
            log_interval=1 if isinstance(config, PPOConfig) else EPISODES_LOGGED,
            reset_num_timesteps=False,
        )
        progress.segment += 1
        callback.record_kl()
        checkpoints.write(config, model, replace(progress, seconds=callback.elapsed))
    callback.finish()
    if progress.best is None:
        policies.save(model, model_file(config), config.scenario)
