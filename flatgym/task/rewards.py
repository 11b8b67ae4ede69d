"""Reward of a step: minus time, optionally shaped by a potential.

The potential is that of `flatgym.task.shaping`; potential differences leave the optimal policy unchanged (Ng, Harada
and Russell 1999, here with discount 1).
"""

from __future__ import annotations

from typing import Any

from flatgym.arrays import namespace
from flatgym.task.scene import GOAL, EpisodeState, Scene
from flatgym.task.shaping import potential


def reward(scene: Scene, before: EpisodeState, after: EpisodeState, shaped: bool) -> Any:
    """Return the reward of the step from `before` to `after` [s], shape (n,).

    Sparse: minus dt. An episode that fails also pays the remaining time limit. The return is minus the flight time on
    success and minus the time limit otherwise.

    Shaped: sparse plus potential(after) - potential(before). Over an episode that terminates these differences sum to a
    constant of its start, minus its potential.
    """
    xp = namespace(after.state)
    failed = after.terminated & (after.outcome != GOAL)
    remaining = xp.astype(scene.max_steps - after.steps, after.state.dtype) * scene.dt
    sparse = -scene.dt - xp.where(failed, remaining, xp.zeros_like(remaining))
    if not shaped:
        return sparse
    return sparse + potential(scene, after) - potential(scene, before)
