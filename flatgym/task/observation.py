"""Observations: encoding of episode states as bounded features, and decoding back to SI units.

A length or speed x appears as x / (u + |x|) with a unit u: one half at u, high resolution near zero, 1 at infinity. The
inverse is x = u o / (1 - |o|). Controllers that know only what a policy observes start from `decode_observation`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.arrays import namespace, on_device_of
from flatgym.quadrotor import STATE_NAMES, Array
from flatgym.task.scene import EpisodeState, Scene

HOOPS_SEEN = 2
"""Number of hoops ahead that are observed."""
OBSERVATION_NAMES = (
    "goal_x",
    "goal_z",
    "velocity_x",
    "velocity_z",
    "sin_theta",
    "cos_theta",
    *(
        f"hoop{i}_{what}"
        for i in range(1, HOOPS_SEEN + 1)
        for what in ("x", "z", "direction_x", "direction_z", "diameter")
    ),
    "floor",
    "ceiling",
    "time",
)
"""Names of the 19 features; FlatQuadEnv documents them."""
OBSERVATIONS = {"features": OBSERVATION_NAMES, "state": STATE_NAMES}
"""Kinds of observations, with the names of their components."""

LENGTH_UNIT, SPEED_UNIT = 2.0, 4.0
"""Length [m] and speed [m/s] that are encoded as one half."""
FAR = 1e12
"""Finite length that stands for infinity; it is encoded as 1 [m]."""


def observation_names(observation: str = "features") -> tuple[str, ...]:
    """Return the names of the components of an observation, "features" or "state"."""
    if not isinstance(observation, str) or observation not in OBSERVATIONS:
        raise ValueError(f"unknown observation {observation!r}; known: {', '.join(OBSERVATIONS)}")
    return OBSERVATIONS[observation]


def squash(value: Any, unit: Any) -> Any:
    """Return value / (unit + |value|) in (-1, 1), elementwise, of arrays of any library."""
    return value / (unit + abs(value))


def unsquash(squashed: Any, unit: Any, margin: float = 0.0) -> Any:
    """Return unit o / (1 - |o|), the inverse of `squash`, elementwise, of arrays of any library.

    `margin` is the smallest value of 1 - |o|. With the default 0, the inverse of +-1 is +-infinity.
    """
    return unit * squashed / (1 - abs(squashed)).clip(margin)


def observe(scene: Scene, episode: EpisodeState, observation: str = "features") -> Any:
    """Return the features named in OBSERVATION_NAMES, all in [-1, 1], shape (n, 19), or the states, shape (n, 5).

    The result is float32.
    """
    state, xp = episode.state, namespace(episode.state)
    if observation == "state":
        return xp.astype(state, xp.float32)
    n, most = scene.hoop_diameter.shape
    x, z, theta, nothing = state[:, 0], state[:, 1], state[:, 4], xp.zeros_like(state[:, 0])
    goal, speed = squash(scene.goal - state[:, 0:2], LENGTH_UNIT), squash(state[:, 2:4], SPEED_UNIT)
    columns = [goal[:, 0], goal[:, 1], speed[:, 0], speed[:, 1], xp.sin(theta), xp.cos(theta)]
    rows = xp.arange(n, **on_device_of(state))
    for i in range(min(HOOPS_SEEN, most)):
        which = xp.clip(episode.hoops_passed + i, 0, most - 1)
        centre, direction = scene.hoop_centre[rows, which], scene.hoop_direction[rows, which]
        hoop = (
            squash(centre[:, 0] - x, LENGTH_UNIT),
            squash(centre[:, 1] - z, LENGTH_UNIT),
            direction[:, 0],
            direction[:, 1],
            squash(scene.hoop_diameter[rows, which], LENGTH_UNIT),
        )
        ahead = episode.hoops_passed + i < scene.hoop_count
        columns += [xp.where(ahead, column, nothing) for column in hoop]
    columns += [nothing] * (len(OBSERVATION_NAMES) - 3 - len(columns))
    for height in (z - scene.floor, scene.ceiling - z):
        columns.append(squash(xp.clip(height, None, FAR), LENGTH_UNIT))
    steps, max_steps = (xp.astype(count, state.dtype) for count in (episode.steps, scene.max_steps))
    columns.append(xp.clip(steps / max_steps, None, 1.0))
    return xp.astype(xp.stack(columns, axis=-1), xp.float32)


class DecodedObservation(NamedTuple):
    """An observation in SI units; `...` are the leading axes of the observations.

    Attributes:
        goal: goal minus position [m], shape (..., 2).
        velocity: (vx, vz) [m/s], shape (..., 2).
        sin, cos: sine and cosine of theta, shape (...).
        hoops: centres of the next hoops minus position [m], shape (..., HOOPS_SEEN, 2).
        directions: their unit vectors of passage, zero without a hoop, shape (..., HOOPS_SEEN, 2).
        diameters: widths of their gaps [m], zero without a hoop, shape (..., HOOPS_SEEN).
        floor: height above the floor [m], infinite without a floor, shape (...).
        ceiling: distance to the ceiling [m], infinite without a ceiling, shape (...).
        time: elapsed fraction of the time limit, shape (...).
    """

    goal: Array
    velocity: Array
    sin: Array
    cos: Array
    hoops: Array
    directions: Array
    diameters: Array
    floor: Array
    ceiling: Array
    time: Array

    @property
    def theta(self) -> Array:
        """The tilt in [-pi, pi] [rad], shape (...)."""
        return np.arctan2(self.sin, self.cos)

    @property
    def ahead(self) -> NDArray[np.bool_]:
        """Whether the hoop exists, shape (..., HOOPS_SEEN)."""
        return np.greater(self.diameters, 0.0)


def decode_observation(observations: ArrayLike) -> DecodedObservation:
    """Return observations of kind "features", shape (..., 19), in SI units, up to their float32 rounding.

    Raises:
        ValueError: for observations of another shape.
    """
    features = np.asarray(observations, dtype=np.float64)
    if features.ndim < 1 or features.shape[-1] != len(OBSERVATION_NAMES):
        raise ValueError(f"observations must have shape (..., {len(OBSERVATION_NAMES)}), got {features.shape}")
    hoops = features[..., 6:-3].reshape(*features.shape[:-1], HOOPS_SEEN, 5)
    with np.errstate(divide="ignore"):  # 1 decodes to infinity
        return DecodedObservation(
            goal=unsquash(features[..., 0:2], LENGTH_UNIT),
            velocity=unsquash(features[..., 2:4], SPEED_UNIT),
            sin=features[..., 4],
            cos=features[..., 5],
            hoops=unsquash(hoops[..., 0:2], LENGTH_UNIT),
            directions=hoops[..., 2:4],
            diameters=unsquash(hoops[..., 4], LENGTH_UNIT),
            floor=unsquash(features[..., -3], LENGTH_UNIT),
            ceiling=unsquash(features[..., -2], LENGTH_UNIT),
            time=features[..., -1],
        )
