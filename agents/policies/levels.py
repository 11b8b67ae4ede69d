"""Numbered actions, for algorithms that choose among finitely many, such as DQN.

    levels = Levels((2, 11))                                                       # 22 actions
    gym.wrappers.TransformAction(gym.make("FlatQuad-v0"), levels.actions, levels)  # an environment for DQN
    DQN("MlpPolicy", NumberedActions(make_vec_env("hoop"), levels))

The action space itself knows which action each number stands for. It is stored with the policy, so that `agents.fly`,
`agents.evaluate` and `agents.policies.load` take the policy like any other.

Stored policies pickle `Levels` by its module path; moving or renaming the class makes them unreadable.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Discrete
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

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


class NumberedActions(VecEnvWrapper):
    """A VecEnv whose actions are numbers of `Levels`."""

    def __init__(self, venv: VecEnv, levels: Levels) -> None:
        super().__init__(venv, action_space=levels)
        self.levels = levels

    def reset(self) -> Any:
        """Reset all episodes."""
        return self.venv.reset()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Start a step with numbers, shape (n,)."""
        self.venv.step_async(self.levels.actions(actions))

    def step_wait(self) -> VecEnvStepReturn:
        """End the step."""
        return self.venv.step_wait()
