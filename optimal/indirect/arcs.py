"""The switching structure: which bang and singular arcs follow one another.

Thrust takes its limits only. The rate takes its limits, or is singular where the tilt follows the velocity costate q.
The structure and the first guess of the boundary-value problem are read from a direct solution.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from flatgym.quadrotor import Array
from optimal.direct.shooting import ShootingSolution
from optimal.indirect.costates import inner_rates

ArcControl = tuple[float, float | None]
"""Thrust [m/s^2] and rate [rad/s] of an arc; the rate of a singular arc is None."""


def arcs_of(shot: ShootingSolution) -> tuple[tuple[ArcControl, ...], Array]:
    """Read the switching structure from the steps of a direct solution without hoops.

    Returns:
        The controls of the n arcs, and a first guess of the unknowns: durations [s], q at the start and its
        slope, shape (n + 4,).
    """
    flight, quadrotor = shot.trajectory, shot.trajectory.quadrotor
    h, slope = np.diff(flight.breakpoints), -shot.costates[0, 0:2]
    q0 = shot.costates[0, 2:4] - slope * h[0]
    turning = np.where(inner_rates(flight.controls, quadrotor), 0.0, np.sign(flight.controls[:, 1]))
    # A single step with an inner rate between two steps at limits contains a switch. It is not an arc.
    alone = (turning[1:-1] == 0) & (turning[:-2] != 0) & (turning[2:] != 0)
    turning[1:-1] = np.where(alone, turning[:-2], turning[1:-1])
    strong = (flight.controls[:, 0] > (quadrotor.thrust_min + quadrotor.thrust_max) / 2) | (turning == 0)
    thrust = np.where(strong, quadrotor.thrust_max, quadrotor.thrust_min)
    pieces: list[tuple[ArcControl, float]] = [
        ((f, sign * quadrotor.rate_max if sign else None), d)
        for f, sign, d in zip(thrust.tolist(), turning.tolist(), h.tolist(), strict=True)
    ]
    # At both ends the tilt is zero and not along q. If no step shows the turn there, it is shorter than a step.
    turn = [math.copysign(quadrotor.rate_max, q[0]) for q in (q0, -q0 - slope * flight.duration)]
    if pieces[0][0][1] is None:
        pieces.insert(0, ((quadrotor.thrust_max, turn[0]), h[0] / 4))
    if pieces[-1][0][1] is None:
        pieces.append(((quadrotor.thrust_max, turn[1]), h[-1] / 4))
    structure, durations = merged_arcs(pieces)
    return structure, np.concatenate([durations, q0, slope])


def merged_arcs(pieces: Sequence[tuple[ArcControl, float]]) -> tuple[tuple[ArcControl, ...], list[float]]:
    """Merge adjacent pieces with equal controls into arcs.

    Where thrust and rate change at the same time, a short arc is inserted that changes one of them first. The
    inserted arc is chosen such that singular arcs keep the greatest thrust.

    Args:
        pieces: controls and durations [s] of consecutive pieces of a flight.

    Returns:
        Controls and durations [s] of the arcs.
    """
    structure, durations = [pieces[0][0]], [0.0]
    for control, length in pieces:
        thrust, rate = structure[-1]
        if thrust != control[0] and rate != control[1]:
            structure.append((thrust, control[1]) if rate is None else (control[0], rate))
            durations.append(min(length, durations[-1]) / 4)
        if structure[-1] != control:
            structure.append(control)
            durations.append(0.0)
        durations[-1] += length
    return tuple(structure), durations
