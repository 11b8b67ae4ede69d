"""Behaviour cloning: a network is fitted to the actions of an expert (Pomerleau 1989).

    clone(load_expert_data(minari.load_dataset("flatquad/hoop/best-known-v0"), "hoop"), CloneConfig(scenario="hoop"))

Time-optimal controls are mostly at a limit, and the environment clips the network's output. Where the expert's action
is at a limit, an output beyond the same limit therefore has no loss. The squared error averages two experts that fly
around a hoop on either side. A categorical actor does not: its loss is the cross-entropy of the expert's bins.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from stable_baselines3 import PPO

from agents.imitation.dataset import ExpertData
from agents.policies.categorical import BinnedDistribution
from agents.policies.networks import act, actor_parameters
from agents.training.configs import PPOConfig
from agents.training.fields import Bins, Checked, Count, Natural, Positive
from agents.training.models import build


@dataclass(frozen=True)
class CloneConfig(Checked):
    """Configuration of behaviour cloning, without the expert data."""

    seed: Natural = 0
    """Seed of the initial weights and the minibatches."""
    width: Count = 96
    """Units of each hidden layer of the actor."""
    depth: Count = 3
    """Hidden layers."""
    observation_scale: Positive = 8.0
    """Scale of all observations except the attitude; large, because bang-bang controls switch within centimetres."""
    guidance: bool = False
    """Whether guidance features replace the time in the observations; see `agents.policies.guidance`."""
    learning_rate: Positive = 2e-3
    """Initial learning rate of a cosine schedule."""
    bins: Bins = None
    """Bins of thrust and rate of a categorical actor, see `agents.policies.categorical`; None for the squared error."""
    batch_size: Count = 512
    """Rows of a minibatch."""
    gradient_steps: Count = 4000
    """Gradient steps."""
    eval_seed: Natural = 500_000
    """Seed of the first validation episode; on a distribution these are neither training nor score episodes."""
    n_eval_episodes: Count = 64
    """Validation episodes on a distribution; a scenario needs one, because it is deterministic."""


def loss(output: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
    """Return the squared error, shape (n, 2), zero where the output is beyond the limit that the action is at."""
    error = output - action
    beyond = (action.abs() >= 1) & (error * action.sign() > 0)
    return torch.where(beyond, torch.zeros_like(error), error.square())


def losses(model: PPO, observations: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
    """Return the losses of a batch: squared errors, shape (n, 2), or cross-entropies of a categorical actor, (n,)."""
    output, kind = act(model, observations), model.policy.action_dist
    if isinstance(kind, BinnedDistribution):
        return -kind.proba_distribution(output).log_prob(actions)
    return loss(output, actions)


def untrained_policy(config: CloneConfig) -> PPO:
    """Return an untrained PPO whose actor is to be fitted; its critic serves a later training with PPO."""
    return build(
        PPOConfig(
            scenario=config.scenario,
            seed=config.seed,
            width=config.width,
            depth=config.depth,
            value_width=64,
            observation_scale=config.observation_scale,
            guidance=config.guidance,
            bins=config.bins,
            num_envs=1,
            batch_size=64,
        )
    )


def fit(model: PPO, data: ExpertData, config: CloneConfig, share: float = 1.0) -> float:
    """Fit the actor to expert data in place, and return the mean loss of the last tenth of the gradient steps.

    Args:
        model: the policy to be trained.
        data: n observations and actions.
        config: batch size, gradient steps and learning rate.
        share: initial share of the learning rate; it falls to a fifth of this share.
    """
    optimizer = torch.optim.Adam(actor_parameters(model), lr=config.learning_rate * share)
    fall = torch.optim.lr_scheduler.CosineAnnealingLR(
        optimizer, config.gradient_steps, config.learning_rate * share / 5
    )
    observations, actions = torch.from_numpy(data.observations), torch.from_numpy(data.actions)
    recent: list[float] = []
    for rows in batches(len(observations), config):
        error = losses(model, observations[rows], actions[rows]).mean()
        optimizer.zero_grad()
        error.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        fall.step()
        recent.append(error.item())
    return float(np.mean(recent[-max(1, config.gradient_steps // 10) :]))


def batches(count: int, config: CloneConfig) -> Iterator[torch.Tensor]:
    """Yield the row numbers of `config.gradient_steps` minibatches from `count` rows, reshuffled every epoch."""
    left = torch.zeros(0, dtype=torch.int64)
    for _ in range(config.gradient_steps):
        while len(left) < min(config.batch_size, count):
            left = torch.cat([left, torch.randperm(count)])
        rows, left = left[: config.batch_size], left[config.batch_size :]
        yield rows


def clone(data: ExpertData, config: CloneConfig) -> PPO:
    """Return a PPO whose actor is fitted to expert data (behaviour cloning); `agents.policies.save` stores it."""
    model = untrained_policy(config)
    fit(model, data, config)
    return model
