"""The bound of the tilt programme for one weight, without hoops and multipliers."""

import numpy as np

from flatgym.quadrotor import Array, Quadrotor
from optimal.proof.programme.tilt_program import Tilts, limits, sweep
from optimal.proof.programme.time_grid import TimeGrid


def greatest_integral(
    quadrotor: Quadrotor, grid: TimeGrid, tilts: Tilts, weight: Array, first: float, last: float, slack: float = 0.0
) -> float:
    """Return the bound of the theorem for one weight, without a bound of the rounding.

    Args:
        quadrotor: the vehicle.
        grid: instants and angles.
        tilts: the class of flights.
        weight: q at the instants, shape (N+1, 2).
        first, last: nonnegative penalties of the first and last tilt.
        slack: greatest deviation of the last tilt from the winding [rad].
    """
    d, zero, rows = grid.angle, np.zeros(2), np.empty((2, len(tilts.sin)))
    arguments = (zero, zero, weight, tilts, last * d * tilts.last, limits(quadrotor, grid), rows, False)
    value = first * d / 2 + last * (slack + d / 2)
    inside = slice(tilts.low[0], tilts.high[0] + 1)
    for begin in (0, 1):
        row = rows[sweep(0, grid.steps, begin, *arguments)] - first * d * tilts.first
        value += float(row[inside].max()) / 2
    return value
