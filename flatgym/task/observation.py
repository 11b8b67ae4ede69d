"""TODO flatgym/task/observation.py."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import STATE_NAMES, Array
from flatgym.task.scene import (
    EpisodeState,
    Scene,
)

HOOPS_SEEN = 2
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
"""What each component of an observation is; FlatQuadEnv documents the scales."""

LENGTH_UNIT, SPEED_UNIT = 2.0, 4.0
"""Length [m] and speed [m/s] that are seen as one half."""
FAR = 1e12
"""Length instead of infinity, so that it is seen as 1 [m]."""
OBSERVATIONS = {"features": OBSERVATION_NAMES, "state": STATE_NAMES}
"""What can be observed, and the names of its components."""


def observation_names(observation: str = "features") -> tuple[str, ...]:
    """Return the names of the components of an observation, "features" or "state"."""
    if not isinstance(observation, str) or observation not in OBSERVATIONS:
        raise ValueError(f"unknown observation {observation!r}; known: {', '.join(OBSERVATIONS)}")
    return OBSERVATIONS[observation]


def _squash(length: Array, unit: float) -> Array:
    """Return length / (unit + |length|): fine near zero, 1/2 at the unit, never quite 1 but for what is infinite."""
    length = np.minimum(length, FAR)
    return length / (unit + np.abs(length))


def observe(scene: Scene, situation: EpisodeState, observation: str = "features") -> NDArray[np.float32]:
    """Return the features named in OBSERVATION_NAMES, all in [-1, 1], shape (n, 19), or the states, shape (n, 5)."""
    if observation == "state":
        return situation.state.astype(np.float32)
    state, n = situation.state, len(scene)
    x, z, theta = state[:, 0], state[:, 1], state[:, 4]
    columns = np.zeros((len(OBSERVATION_NAMES), n))
    columns[0:2] = _squash(scene.goal - state[:, 0:2], LENGTH_UNIT).T
    columns[2:4] = _squash(state[:, 2:4], SPEED_UNIT).T
    columns[4], columns[5] = np.sin(theta), np.cos(theta)
    for i in range(min(HOOPS_SEEN, scene.hoop_centre.shape[1])):
        ahead = np.flatnonzero(situation.hoops_passed + i < scene.hoop_count)
        which = situation.hoops_passed[ahead] + i
        centre, direction = scene.hoop_centre[ahead, which], scene.hoop_direction[ahead, which]
        row = 6 + 5 * i
        columns[row, ahead] = _squash(centre[:, 0] - x[ahead], LENGTH_UNIT)
        columns[row + 1, ahead] = _squash(centre[:, 1] - z[ahead], LENGTH_UNIT)
        columns[row + 2 : row + 4, ahead] = direction.T
        columns[row + 4, ahead] = _squash(scene.hoop_diameter[ahead, which], LENGTH_UNIT)
    columns[-3] = _squash(z - scene.floor, LENGTH_UNIT)
    columns[-2] = _squash(scene.ceiling - z, LENGTH_UNIT)
    columns[-1] = np.minimum(situation.steps / scene.max_steps, 1.0)
    return np.ascontiguousarray(columns.T, dtype=np.float32)
