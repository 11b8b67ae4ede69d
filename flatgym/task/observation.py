"""Observations: encoding of episode states as bounded features, and decoding back to SI units.

A length or speed x appears as x / (u + |x|) with a unit u: one half at u, high resolution near zero, 1 at infinity. The
inverse is x = u o / (1 - |o|). Controllers that know only what a policy observes start from `decode_observation`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
    """Return value / (unit + |value|) in (-1, 1), elementwise, of NumPy arrays or torch tensors."""
    return value / (unit + abs(value))


def unsquash(squashed: Any, unit: Any, margin: float = 0.0) -> Any:
    """Return unit o / (1 - |o|), the inverse of `squash`, elementwise, of NumPy arrays or torch tensors.

    `margin` is the smallest value of 1 - |o|. With the default 0, the inverse of +-1 is +-infinity.
    """
    return unit * squashed / (1 - abs(squashed)).clip(margin)


def observe(scene: Scene, episode: EpisodeState, observation: str = "features") -> NDArray[np.float32]:
    """Return the features named in OBSERVATION_NAMES, all in [-1, 1], shape (n, 19), or the states, shape (n, 5)."""
    if observation == "state":
        return episode.state.astype(np.float32)
    state, n = episode.state, len(scene)
    x, z, theta = state[:, 0], state[:, 1], state[:, 4]
    columns = np.zeros((len(OBSERVATION_NAMES), n))
    columns[0:2] = squash(scene.goal - state[:, 0:2], LENGTH_UNIT).T
    columns[2:4] = squash(state[:, 2:4], SPEED_UNIT).T
    columns[4], columns[5] = np.sin(theta), np.cos(theta)
    for i in range(min(HOOPS_SEEN, scene.hoop_centre.shape[1])):
        ahead = np.flatnonzero(episode.hoops_passed + i < scene.hoop_count)
        which = episode.hoops_passed[ahead] + i
        centre, direction = scene.hoop_centre[ahead, which], scene.hoop_direction[ahead, which]
        row = 6 + 5 * i
        columns[row, ahead] = squash(centre[:, 0] - x[ahead], LENGTH_UNIT)
        columns[row + 1, ahead] = squash(centre[:, 1] - z[ahead], LENGTH_UNIT)
        columns[row + 2 : row + 4, ahead] = direction.T
        columns[row + 4, ahead] = squash(scene.hoop_diameter[ahead, which], LENGTH_UNIT)
    columns[-3] = squash(np.minimum(z - scene.floor, FAR), LENGTH_UNIT)
    columns[-2] = squash(np.minimum(scene.ceiling - z, FAR), LENGTH_UNIT)
    columns[-1] = np.minimum(episode.steps / scene.max_steps, 1.0)
    return np.ascontiguousarray(columns.T, dtype=np.float32)


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
