"""Observation and action spaces of both environments, and the check of actions."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from flatgym.arrays import namespace
from flatgym.quadrotor import Array, Quadrotor
from flatgym.task.observation import observation_names
from flatgym.validation import numbers


def observation_space(observation: str = "features") -> gym.Space[Any]:
    """Return the space of one observation; `observation_names` names its components."""
    most = 1.0 if observation == "features" else np.inf
    return gym.spaces.Box(-most, most, (len(observation_names(observation)),), np.float32)


def action_space() -> gym.Space[Any]:
    """Return the space of one action: thrust and rate, scaled to [-1, 1]."""
    return gym.spaces.Box(-1.0, 1.0, (2,), np.float32)


def take_actions(actions: ArrayLike, into: Array) -> None:
    """Copy actions into an array of the same shape.

    Raises:
        ValueError: for another shape, and for values that are not numbers.
    """
    values = numbers("actions", actions)
    if values.shape != into.shape:
        raise ValueError(f"actions must have shape {into.shape}, got {values.shape}")
    into[...] = values


def controls_of(quadrotor: Quadrotor, actions: Any) -> Any:
    """Return the controls [thrust, rate] of actions clipped to the box, arrays of any library, shape (..., 2).

    Where an action is not finite, both are nan, which ends an episode (`flatgym.task.advance`).
    """
    xp = namespace(actions)
    usable = xp.all(xp.isfinite(actions), axis=-1)[..., None]
    return xp.where(usable, quadrotor.control(xp.clip(actions, -1.0, 1.0)), xp.full_like(actions, xp.nan))
