"""Which numbers of turns can no longer win, judged by the costates of a flight already found.

For any q(t) = q0 + q1 t a flight of duration T over the displacement D, from rest to rest, has

    integral of q . a dt = -q1 . D,   a = f e(theta) - g e_z,

so no flight with `winding` turns takes T if the greatest value that integral can have, over all tilts
from 0 to 2 pi winding with |theta'| <= rate_max, is less. The tilt is all that is left of the state,
so a dynamic programme on a grid of angles finds that value, for all windings at once: forwards,

    V(t + dt, theta) = r(t + dt, theta) dt/2 + max over |theta' - theta| <= rate_max dt of V(t, theta') + r dt/2,

with r the greatest q . a at that tilt.

This is an estimate and no proof, as the sums stand for integrals: it steers a search, which is none either. The
grid lets the tilt turn a little too fast, which errs on the side of trying a winding in vain.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.direct.shooting import ShootingSolution

STEPS = 40
"""Steps of the dynamic programme."""
ANGLES = 256
"""Angles of one turn."""
SLACK = 3e-3
"""How much more time than the fastest flight a winding is granted before it is left out, relatively."""


def pruned_windings(scenario: Scenario, shot: ShootingSolution, duration: float, windings: Iterable[int]) -> set[int]:
    """Return which windings seem to allow no flight as fast as `duration`.

    Args:
        scenario: what to fly; heights are left out, which can only keep a winding in.
        shot: a flight of it, whose costates weigh the acceleration.
        duration: the time to beat [s].
        windings: whole turns in question.
    """
    windings = set(windings)
    if scenario.hoops or not windings:  # each hoop bends q, and its passing time is not known
        return set()
    start, slope = line(shot, duration)
    needed = -float(slope @ (np.array(scenario.goal) - scenario.start))
    values = greatest(scenario, start, slope, duration, max(map(abs, windings)))
    return {winding for winding in windings if values[len(values) // 2 + winding * ANGLES] < needed}


def line(shot: ShootingSolution, time: float) -> tuple[Array, Array]:
    """Return q at the start and its slope from a flight's costates, stretched to `time`, each shape (2,)."""
    slope = -shot.costates[0, 0:2]
    start = shot.costates[0, 2:4] - slope * shot.trajectory.breakpoints[1]
    return start, slope * shot.trajectory.duration / time


def greatest(scenario: Scenario, start: Array, slope: Array, time: float, turns: int) -> Array:
    """Return the greatest integral of q . a over tilts from 0 to each angle of the grid.

    Args:
        scenario: its vehicle's limits count.
        start, slope: of q, each shape (2,).
        time: duration [s].
        turns: most turns, either way.

    Returns:
        Values at the angles from -(turns + 1) to turns + 1 turns, shape (2 (turns + 1) ANGLES + 1,).
    """
    quadrotor, dt = scenario.quadrotor, time / STEPS
    angle = 2 * np.pi * np.arange(ANGLES) / ANGLES
    q = start + slope * np.linspace(0.0, time, STEPS + 1)[:, None]
    lift = q @ np.stack([np.sin(angle), np.cos(angle)])
    reward = np.maximum(quadrotor.thrust_max * lift, quadrotor.thrust_min * lift) - quadrotor.gravity * q[:, 1:]
    reward = np.tile(reward * dt, 2 * (turns + 1))
    reward = np.concatenate([reward, reward[:, :1]], axis=1)
    reach = int(np.ceil(quadrotor.rate_max * dt * ANGLES / (2 * np.pi)))
    values = np.full(reward.shape[1] + 2 * reach, -np.inf)  # with as many angles beyond either end as one step reaches
    inner = slice(reach, reach + reward.shape[1])
    values[reach + (turns + 1) * ANGLES] = 0.0
    for i in range(STEPS):
        values[inner] += reward[i] / 2
        values[inner] = widest(values, reach) + reward[i + 1] / 2
    return values[inner]


def widest(values: Array, reach: int) -> Array:
    """Return the greatest of each 2 reach + 1 neighbouring values, shape (n - 2 reach,), by doubling."""
    width = 1
    while width < 2 * reach + 1:
        shift = min(width, 2 * reach + 1 - width)
        values = np.maximum(values[:-shift], values[shift:])
        width += shift
    return values
