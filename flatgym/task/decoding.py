"""What an observation says, back in metres and metres per second.

Observations show a length l as l / (u + |l|), so o = l / (u + |l|) is l = u o / (1 - |o|); speeds likewise
with a unit of their own. What is infinitely far is seen as 1. Controllers and planners that know nothing
of the scenario but what any policy sees begin here.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Array
from flatgym.task.observation import HOOPS_SEEN, LENGTH_UNIT, OBSERVATION_NAMES, SPEED_UNIT


class DecodedObservation(NamedTuple):
    """An observation in SI units; shapes behind the leading axes of the observations.

    Attributes:
        goal: way to the goal [m], shape (..., 2).
        velocity: (vx, vz) [m/s], shape (..., 2).
        sin, cos: of the tilt, shape (...).
        hoops: ways to the centres of the next hoops [m], shape (..., HOOPS_SEEN, 2).
        directions: their directions of passage, unit vectors, zero where there is no hoop, as `hoops`.
        diameters: widths of their gaps [m], zero where there is no hoop, shape (..., HOOPS_SEEN).
        floor: height above the floor [m], shape (...); infinite where there is none.
        ceiling: way up to the ceiling [m], shape (...); infinite where there is none.
        time: share of the time limit that has passed, shape (...).
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
        """Whether there is such a hoop, shape (..., HOOPS_SEEN)."""
        return np.greater(self.diameters, 0.0)


def decode_observation(observations: ArrayLike) -> DecodedObservation:
    """Return what observations of the kind "features" say, shape (..., 19), exact up to their float32 rounding.

    Raises:
        ValueError: for observations of another shape.
    """
    seen = np.asarray(observations, dtype=np.float64)
    if seen.ndim < 1 or seen.shape[-1] != len(OBSERVATION_NAMES):
        raise ValueError(f"observations must have shape (..., {len(OBSERVATION_NAMES)}), got {seen.shape}")
    hoops = seen[..., 6:-3].reshape(*seen.shape[:-1], HOOPS_SEEN, 5)
    return DecodedObservation(
        goal=_length(seen[..., 0:2]),
        velocity=_length(seen[..., 2:4], SPEED_UNIT),
        sin=seen[..., 4],
        cos=seen[..., 5],
        hoops=_length(hoops[..., 0:2]),
        directions=hoops[..., 2:4],
        diameters=_length(hoops[..., 4]),
        floor=_length(seen[..., -3]),
        ceiling=_length(seen[..., -2]),
        time=seen[..., -1],
    )


def _length(seen: Any, unit: float = LENGTH_UNIT) -> Array:
    """Return the length that is seen as `seen`, infinite at 1."""
    rest = 1 - np.abs(seen)
    return np.where(rest > 0, unit * seen / np.where(rest > 0, rest, 1.0), np.copysign(np.inf, seen))
