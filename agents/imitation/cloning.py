"""TODO agents/imitation/cloning.py."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from stable_baselines3 import PPO

from agents.imitation.dataset import Shown
from agents.policies.networks import act, actor_parameters
from agents.training.configs import PPOConfig
from agents.training.fields import Checked, Count, Natural, Positive
from agents.training.models import build


@dataclass(frozen=True)
class CloneConfig(Checked):
    """Everything a cloning depends on, besides what is shown."""

    seed: Natural = 0
    """Seed of network and batches."""
    width: Count = 96
    """Units of each hidden layer of the actor."""
    depth: Count = 3
    """Hidden layers."""
    observation_scale: Positive = 8.0
    """Factor on all observations but the attitude, before the network: bang-bang controls switch within centimetres."""
    guidance: bool = False
    """Whether the network sees what guidance laws steer by as well, and not the time; see `agents.policies.guidance`."""
    learning_rate: Positive = 2e-3
    """Learning rate at the beginning, falling along a cosine."""
    batch_size: Count = 512
    """Size of a minibatch."""
    gradient_steps: Count = 4000
    """Gradient steps."""
    eval_seed: Natural = 500_000
    """Seed of the flights by which policies are ranked; on a distribution neither those trained on nor those scored."""
    n_eval_episodes: Count = 64
    """Their number on a distribution; on a scenario one tells all."""


def loss(output: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
    """Return the squared error, shape (n, 2), zero where output and action are beyond the same limit."""
    error = output - action
    beyond = (action.abs() >= 1) & (error * action.sign() > 0)
    return torch.where(beyond, torch.zeros_like(error), error.square())


def student(config: CloneConfig) -> PPO:
    """Return an untrained PPO whose actor is to learn; its critic is for whoever goes on with PPO."""
    return build(
        PPOConfig(
            scenario=config.scenario,
            seed=config.seed,
            width=config.width,
            depth=config.depth,
            value_width=64,
            observation_scale=config.observation_scale,
            guidance=config.guidance,
            num_envs=1,
            batch_size=64,
        )
    )


def fit(model: PPO, shown: Shown, config: CloneConfig, share: float = 1.0) -> float:
    """Fit the actor to what was shown; return the mean loss of the last tenth of the updates.

    Args:
        model: is changed.
        shown: n observations and actions.
        config: batch, updates and learning rate.
        share: of the learning rate to begin with; a fifth of it is left at the end.
    """
    optimizer = torch.optim.Adam(actor_parameters(model), lr=config.learning_rate * share)
    fall = torch.optim.lr_scheduler.CosineAnnealingLR(
        optimizer, config.gradient_steps, config.learning_rate * share / 5
    )
    observations, actions = torch.from_numpy(shown.observations), torch.from_numpy(shown.actions)
    recent: list[float] = []
    for rows in batches(len(observations), config):
        error = loss(act(model, observations[rows]), actions[rows]).mean()
        optimizer.zero_grad()
        error.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        fall.step()
        recent.append(error.item())
    return float(np.mean(recent[-max(1, config.gradient_steps // 10) :]))


def batches(count: int, config: CloneConfig) -> Iterator[torch.Tensor]:
    """Yield the rows of `config.gradient_steps` minibatches of `count` rows, pass after pass in a new order."""
    left = torch.zeros(0, dtype=torch.int64)
    for _ in range(config.gradient_steps):
        while len(left) < min(config.batch_size, count):
            left = torch.cat([left, torch.randperm(count)])
        rows, left = left[: config.batch_size], left[config.batch_size :]
        yield rows


def clone(shown: Shown, config: CloneConfig) -> PPO:
    """Return a PPO whose actor imitates what was shown (behaviour cloning); `agents.policies.save` keeps it."""
    model = student(config)
    fit(model, shown, config)
    return model
