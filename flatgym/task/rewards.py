"""TODO flatgym/task/reward.py."""

from __future__ import annotations

import numpy as np

from flatgym.quadrotor import Array
from flatgym.task.scene import (
    GOAL,
    EpisodeState,
    Scene,
)
from flatgym.task.shaping import potential


def reward(scene: Scene, before: EpisodeState, after: EpisodeState, shaped: bool) -> Array:
    """Return the reward of the step from `before` to `after` [s], shape (n,).

    Sparse: minus dt; a flight that fails pays the rest of its time limit at once, so that the
    return is minus the flight time on success and minus the time limit otherwise. Shaped adds
    the difference of the potential; summed over an episode it is a constant of the start, so
    the optimal policy stays the same (Ng, Harada and Russell 1999, with discount 1).
    """
    failed = after.terminated & (after.outcome != GOAL)
    rest = (scene.max_steps - after.steps) * scene.dt
    sparse = -scene.dt - np.where(failed, rest, 0.0)
    if not shaped:
        return sparse
    return sparse + potential(scene, after) - potential(scene, before)
