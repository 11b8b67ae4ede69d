"""What a training depends on: one flat dataclass, a sentence for each field."""

from __future__ import annotations

from dataclasses import dataclass

TIGHT = 0.4
"""Share of the steps after which the tolerance is the true one."""


@dataclass(frozen=True)
class PPOConfig:
    """Everything a training depends on."""

    scenario: str = "hoop"
    """Name of the scenario."""
    seed: int = 0
    """Seed of starts, network and exploration."""
    seconds: float = 250.0
    """Wall time after which training stops [s]; on a machine so slow that this comes first, the schedules
    run over it instead of over `env_steps`."""
    env_steps: int = 5_000_000
    """Environment steps over which all schedules run, and after which training stops."""
    folder: str = "runs/ppo"
    """Where model, configuration and learning curve are written."""
    num_envs: int = 256
    """Vehicles flown at once."""
    rollout: int = 64
    """Steps of each vehicle between two updates."""
    batch: int = 4096
    """Size of a minibatch."""
    epochs: int = 6
    """Passes over a rollout."""
    width: int = 64
    """Units of each of two hidden layers."""
    zoom: float = 3.0
    """Factor on all observations but the attitude, before the network."""
    log_std: float = -0.7
    """Logarithm of the exploration's standard deviation at the beginning."""
    learning_rate: float = 1e-3
    """Learning rate of the first update; then it follows the divergence."""
    learning_rate_max: float = 2e-2
    """Largest learning rate."""
    divergence: float = 0.03
    """Wanted Kullback-Leibler divergence of an update at the beginning, falling linearly."""
    divergence_end: float = 0.02
    """Share of it that is wanted at the end."""
    discount: float = 0.98
    """Discount at the beginning."""
    discount_end: float = 0.995
    """Discount after three fifths of the steps."""
    gae: float = 0.95
    """Lambda of generalised advantage estimation."""
    tolerance: float = 3.0
    """Factor on the tolerance at the beginning, falling to 1 by TIGHT of the steps."""
    drawn: float = 0.8
    """Share of flights that begin elsewhere than at the start, until the tolerance is the true one."""
    drawn_end: float = 0.1
    """The same share at the end."""
    near: float = 0.125
    """Share of these that begin around the goal; the others at states flown backwards from it."""
    back_time: float = 1.0
    """Longest time flown backwards [s]."""
    failure: float = 0.5
    """What a failed flight costs in training [s]; the environment's own charge, the rest of the time
    limit, frightens a beginner away from the goal."""
    check_every: int = 5
    """Rollouts between two flights of the deterministic policy."""
