"""Pruning of windings that cannot be the fastest, by the costates of a flight already found.

For any q(t) = q0 + q1 t, a flight of duration T over the displacement D, from rest to rest, has

    integral of q . a dt = -q1 . D,   a = f e(theta) - g e_z,

A winding has no flight of duration T if the maximum of that integral, over all tilts from 0 to 2 pi winding with
|theta'| <= rate_max, is smaller. The tilt is the only remaining state. A dynamic programme on a grid of angles finds
the maximum for all windings at once, forwards in time:

    V(t + dt, theta) = r(t + dt, theta) dt/2 + max over |theta' - theta| <= rate_max dt of V(t, theta') + r dt/2,

with r the greatest q . a at that tilt.

The result guides the search and proves nothing, because sums replace the integrals. The grid lets the tilt turn a
little too fast. That error keeps a winding in.
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
"""Relative excess over the fastest time up to which a winding is still tried."""


def pruned_windings(scenario: Scenario, shot: ShootingSolution, duration: float, windings: Iterable[int]) -> set[int]:
    """Return the windings for which a flight as fast as `duration` seems impossible.

    Args:
        scenario: the task; its floor and ceiling are ignored, which can only keep a winding in.
        shot: a flight of it, whose costates weigh the acceleration.
        duration: the flight time [s].
        windings: whole turns in question.
    """
    windings = set(windings)
    if scenario.hoops or not windings:  # each hoop bends q at a passing time that is not known
        return set()
    start, slope = costate_line(shot, duration)
    needed = -float(slope @ (np.array(scenario.goal) - scenario.start))
    values = greatest_integrals(scenario, start, slope, duration, max(map(abs, windings)))
    return {winding for winding in windings if values[len(values) // 2 + winding * ANGLES] < needed}


def costate_line(shot: ShootingSolution, time: float) -> tuple[Array, Array]:
    """Return q at the start and its slope, from a flight's costates scaled to the duration `time`, each shape (2,)."""
    slope = -shot.costates[0, 0:2]
    start = shot.costates[0, 2:4] - slope * shot.trajectory.breakpoints[1]
    return start, slope * shot.trajectory.duration / time


def greatest_integrals(scenario: Scenario, start: Array, slope: Array, time: float, turns: int) -> Array:
    """Return the greatest integral of q . a over tilts from 0 to each angle of the grid.

    Args:
        scenario: the limits of its vehicle are used.
        start, slope: of q, each shape (2,).
        time: duration [s].
        turns: largest number of whole turns, in both directions.

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
    values = np.full(reward.shape[1] + 2 * reach, -np.inf)  # padded at both ends by the angles that one step reaches
    inner = slice(reach, reach + reward.shape[1])
    values[reach + (turns + 1) * ANGLES] = 0.0
    for i in range(STEPS):
        values[inner] += reward[i] / 2
        values[inner] = sliding_maximum(values, reach) + reward[i + 1] / 2
    return values[inner]


def sliding_maximum(values: Array, reach: int) -> Array:
    """Return the maximum of each 2 reach + 1 neighbouring values, shape (n - 2 reach,), by doubling the window."""
    width = 1
    while width < 2 * reach + 1:
        shift = min(width, 2 * reach + 1 - width)
        values = np.maximum(values[:-shift], values[shift:])
        width += shift
    return values
