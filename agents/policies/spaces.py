"""What a policy observes: one observation of the environment, or several in a row, features or states.

    layout(model.observation_space)        # Layout(observation="features", frames=4, joined=True)
    policy, observation = fit(model)       # takes single observations of this kind

Frames are stacked as in the training: by VecFrameStack of Stable-Baselines3 into a longer vector that begins with
zeros, or by FrameStackObservation of Gymnasium into a matrix that begins with copies of the first observation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import NDArray

from agents.policies.policy import Policy
from flatgym.envs.levels import Levels
from flatgym.envs.spaces import action_space, observation_space
from flatgym.task.observation import OBSERVATIONS


@dataclass(frozen=True)
class Layout:
    """The observations that a policy takes.

    Attributes:
        observation: "features" or "state", the argument of FlatQuad-v0.
        frames: number of observations in a row, the newest last.
        joined: whether the frames follow one another in a vector, shape (frames * m,), or form a matrix (frames, m).
    """

    observation: str = "features"
    frames: int = 1
    joined: bool = True

    @property
    def single(self) -> Space[Any]:
        """The space of one observation."""
        return observation_space(self.observation)

    @property
    def space(self) -> Box:
        """The space of the frames together."""
        assert isinstance(self.single, Box)
        low, high = (np.tile(bound, (self.frames, 1)) for bound in (self.single.low, self.single.high))
        return Box(low.ravel(), high.ravel()) if self.joined else Box(low, high)


def layouts(shape: tuple[int, ...]) -> list[Layout]:
    """Return the layouts of observations of a shape, the most probable first; none for a shape that does not fit."""
    found = []
    for kind, names in OBSERVATIONS.items():
        if len(shape) == 1 and shape[0] and shape[0] % len(names) == 0:
            found.append(Layout(kind, shape[0] // len(names)))
        if len(shape) == 2 and shape[0] and shape[1] == len(names):
            found.append(Layout(kind, shape[0], joined=False))
    return sorted(found, key=lambda one: one.frames)


def layout(space: Any, exact: bool = False) -> Layout:
    """Return the layout of the observations of a space.

    Args:
        space: the observation space of a policy.
        exact: refuse a single observation with other bounds, which a wrapper of the environment has changed. A stack
            always needs the bounds.

    Raises:
        ValueError: naming both spaces, for a space that FlatQuad-v0 has with no keywords and no stacking.
    """
    found = layouts(getattr(space, "shape", None) or ())
    fitting = [one for one in found if isinstance(space, Box) and _same_bounds(one.space, space)]
    single = [one for one in found if one.frames == 1 and one.joined]
    if fitting or (single and not exact):
        return (fitting or single)[0]
    advice = "pass an object whose predict() converts observations"
    if single:
        raise ValueError(
            f"its observation_space {space} has the shape of {single[0].space} but other bounds: it was trained behind "
            f"a wrapper that changes observations, such as NormalizeObservation; {advice}"
        )
    known = " or ".join(f"({len(names)},) for {kind}" for kind, names in OBSERVATIONS.items())
    raise ValueError(
        f"it has an observation_space of shape {getattr(space, 'shape', None)}, {space}, but FlatQuad-v0 one of shape "
        f"{known}, or a stack of these; train it in FlatQuad-v0, or {advice}"
    )


def _same_bounds(one: Box, other: Box) -> bool:
    return np.array_equal(one.low, other.low) and np.array_equal(one.high, other.high)


def check_actions(space: Any, exact: bool = False) -> None:
    """Raise a ValueError for an action space of another shape than FlatQuad-v0's; if `exact`, of other bounds too.

    `Levels` numbers actions of FlatQuad-v0, so it fits.
    """
    wanted = action_space()
    if isinstance(space, Levels):
        return
    if (space != wanted) if exact else (getattr(space, "shape", None) != wanted.shape):
        raise ValueError(
            f"it has an action_space of shape {getattr(space, 'shape', None)}, {space}, but FlatQuad-v0 one of shape "
            f"{wanted.shape}, {wanted}; train it in FlatQuad-v0, for discrete actions with those numbered by "
            "flatgym.envs.levels, or pass an object whose predict() converts actions"
        )


def fit(policy: Policy) -> tuple[Policy, str]:
    """Return a policy that takes single observations, and their kind: "features", or "state".

    A policy without an observation space is expected to take features.

    Raises:
        ValueError: for spaces that do not fit; names both shapes.
    """
    try:
        if (actions := getattr(policy, "action_space", None)) is not None:
            check_actions(actions)
        if isinstance(actions, Levels):
            policy = Numbered(policy, actions)
        if (space := getattr(policy, "observation_space", None)) is None:
            return policy, "features"
        seen = layout(space)
    except ValueError as error:
        raise ValueError(f"the policy does not fit: {error}") from None
    return unstacked(policy, seen), seen.observation


def unstacked(policy: Policy, seen: Layout) -> Policy:
    """Return a policy that takes single observations and passes on the last few of each vehicle."""
    return policy if seen.frames == 1 and seen.joined else Stacked(policy, seen)


class Wrapped:
    """A policy that changes the observations or actions of another.

    Attributes:
        policy: the other policy.
        observation_space: the space of the observations that this one takes.
        action_space: the space of its actions, None if the other has none.
    """

    def __init__(self, policy: Policy, space: Any) -> None:
        self.policy, self.observation_space = policy, space
        self.action_space = getattr(policy, "action_space", None)


class Numbered(Wrapped):
    """A policy of numbered actions, which returns the actions themselves."""

    def __init__(self, policy: Policy, levels: Levels) -> None:
        super().__init__(policy, getattr(policy, "observation_space", None))
        self.levels, self.action_space = levels, action_space()

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions (n, 2) for observations of shape (n, m), and the state of the policy."""
        numbers, state = self.policy.predict(
            observation, state=state, episode_start=episode_start, deterministic=deterministic
        )
        return self.levels.actions(numbers), state


class Stacked(Wrapped):
    """A policy of several frames, which takes one observation at a time; its state holds the frames."""

    def __init__(self, policy: Policy, seen: Layout) -> None:
        super().__init__(policy, seen.single)
        self.seen = seen

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Return actions (n, 2) for observations (n, m), and the state: frames (n, frames, m), state of the policy."""
        newest = np.asarray(observation)
        count, length = newest.shape
        blank = np.zeros((count, self.seen.frames, length), newest.dtype)
        frames, inner = (blank, None) if state is None else state
        starts = np.full(count, state is None) if state is None or episode_start is None else episode_start
        first = blank if self.seen.joined else blank + newest[:, None]
        frames = np.where(starts[:, None, None], first, np.roll(frames, -1, axis=1))
        frames[:, -1] = newest
        seen = frames.reshape(count, -1) if self.seen.joined else frames
        actions, inner = self.policy.predict(
            seen, state=inner, episode_start=episode_start, deterministic=deterministic
        )
        return actions, (frames, inner)
