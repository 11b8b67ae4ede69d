"""TODO optimal/indirect/arcs.py."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from flatgym.quadrotor import Array
from optimal.direct.shooting import ShootingSolution
from optimal.indirect.costates import inner_rates

ArcControl = tuple[float, float | None]
"""Thrust [m/s^2] and rate [rad/s] of an arc; None is the rate of a singular arc."""


def arcs_of(shot: ShootingSolution) -> tuple[tuple[ArcControl, ...], Array]:
    """Read off the arcs that the steps of a direct solution without hoops stand for.

    Returns:
        The modes of the n arcs, and about how long each lasts [s] followed by q at the start and its slope,
        shape (n + 4,).
    """
    flight, quadrotor = shot.trajectory, shot.trajectory.quadrotor
    h, slope = np.diff(flight.breakpoints), -shot.costates[0, 0:2]
    q0 = shot.costates[0, 2:4] - slope * h[0]
    turning = np.where(inner_rates(flight.controls, quadrotor), 0.0, np.sign(flight.controls[:, 1]))
    # A lone step between two limits is where the rate switches, not an arc.
    alone = (turning[1:-1] == 0) & (turning[:-2] != 0) & (turning[2:] != 0)
    turning[1:-1] = np.where(alone, turning[:-2], turning[1:-1])
    strong = (flight.controls[:, 0] > (quadrotor.thrust_min + quadrotor.thrust_max) / 2) | (turning == 0)
    thrust = np.where(strong, quadrotor.thrust_max, quadrotor.thrust_min)
    pieces = [
        ((f, sign * quadrotor.rate_max if sign else None), d)
        for f, sign, d in zip(thrust.tolist(), turning.tolist(), h.tolist(), strict=True)
    ]
    # The tilt is off q at both ends: if no step shows the turn towards q, or back, it is shorter than one.
    turn = [math.copysign(quadrotor.rate_max, q[0]) for q in (q0, -q0 - slope * flight.duration)]
    if pieces[0][0][1] is None:
        pieces.insert(0, ((quadrotor.thrust_max, turn[0]), h[0] / 4))
    if pieces[-1][0][1] is None:
        pieces.append(((quadrotor.thrust_max, turn[1]), h[-1] / 4))
    modes, durations = sequence(pieces)
    return modes, np.concatenate([durations, q0, slope])


def sequence(pieces: Sequence[tuple[ArcControl, float]]) -> tuple[tuple[ArcControl, ...], list[float]]:
    """Return the arcs that pieces of flight make up, and how long each lasts [s].

    Like neighbours are joined, and where thrust and rate change at once a short arc is put between, such that
    singular arcs keep the greatest thrust.
    """
    modes, durations = [pieces[0][0]], [0.0]
    for mode, length in pieces:
        thrust, rate = modes[-1]
        if thrust != mode[0] and rate != mode[1]:
            modes.append((thrust, mode[1]) if rate is None else (mode[0], rate))
            durations.append(min(length, durations[-1]) / 4)
        if modes[-1] != mode:
            modes.append(mode)
            durations.append(0.0)
        durations[-1] += length
    return tuple(modes), durations
