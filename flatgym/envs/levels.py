"""Numbered actions, for algorithms that choose among finitely many, such as DQN.

    levels = Levels((2, 11))                                                       # 22 actions
    gym.wrappers.TransformAction(gym.make("FlatQuad-v0"), levels.actions, levels)  # an environment for DQN

The action space itself knows which action each number stands for. It is stored with a policy, so that scores take the
policy like any other.

Stored policies pickle `Levels` by its module path; moving or renaming the class makes them unreadable.
"""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Discrete
from numpy.typing import ArrayLike, NDArray

from flatgym.validation import whole

NAMES = ("thrust", "rate")
"""The actions, in the order of the action box."""


class Levels(Discrete):
    """The numbers of all combinations of evenly spaced levels of thrust and rate, both limits included.

    Args:
        bins: number of levels of thrust, at least 2, and of rate; an odd number holds the rate zero.

    Raises:
        ValueError: for fewer than two levels.
    """

    def __init__(self, bins: tuple[int, int]) -> None:
        thrust, rate = (whole(f"Levels of {name}", count, 2, 1001) for name, count in zip(NAMES, bins, strict=True))
        self.bins = thrust, rate
        super().__init__(thrust * rate)

    def actions(self, numbers: ArrayLike) -> NDArray[np.float32]:
        """Return the actions, shape (..., 2), of numbers of shape (...)."""
        indices = np.unravel_index(np.asarray(numbers), self.bins)
        parts = [2 * index / (count - 1) - 1 for index, count in zip(indices, self.bins, strict=True)]
        return np.stack(parts, axis=-1).astype(np.float32)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Levels) and self.bins == other.bins

    __hash__ = None  # type: ignore[assignment]  # as of all spaces
