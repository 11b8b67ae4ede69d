"""Agents that know nothing: one hovers, one acts at random. A task in which they succeed measures nothing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Quadrotor


@dataclass(frozen=True)
class Hover:
    """Holds the thrust that carries the weight and the rate zero, and so stays where it starts.

    Attributes:
        quadrotor: the vehicle.
    """

    quadrotor: Quadrotor = field(default_factory=Quadrotor)

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,  # noqa: ARG002 - as Stable-Baselines3 calls it
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions (..., 2) for observations (..., 19), and `state` unchanged."""
        action = self.quadrotor.action(np.array([self.quadrotor.gravity, 0.0]))
        return np.tile(action.astype(np.float32), (*np.shape(observation)[:-1], 1)), state


class RandomActions:
    """Draws every action uniformly from the action box, also where a deterministic one is asked for.

    Args:
        seed: of the generator; two agents of one seed act alike.
    """

    def __init__(self, seed: int = 0) -> None:
        self._generator = np.random.default_rng(seed)

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions (..., 2) for observations (..., 19), and `state` unchanged."""
        size = (*np.shape(observation)[:-1], 2)
        return self._generator.uniform(-1, 1, size).astype(np.float32), state
