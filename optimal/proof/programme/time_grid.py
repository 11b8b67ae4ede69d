"""The grids of the dynamic programmes: instants, and angles that divide a whole turn evenly.

All windings end on a grid. Where controls may change at any time (`TimeGrid`), the vehicle turns by at most one angle
in a time step. Where controls are held over environment steps (`HoldGrid`), the instants divide the steps, and the
angles are finer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from optimal.proof.programme.rounding import UNIT_ROUNDOFF

DEFAULT_ANGLES = 400
"""Least angles of one turn for a gap of 1e-3."""
ANGLE_RANGE = 0.2
"""Range of the number of angles that is searched, relative to the least one."""
REACH_RANGE = 0.5
"""Range of the angles of one environment step that is searched, relative to the least number."""
LEAST_STEPS = 100
"""Fewest instants of a grid, for vehicles that turn little in the time they have."""


@dataclass(frozen=True)
class TimeGrid:
    """Instants t_k = k dt, where the vehicle can turn by at most one of `turn` equal angles in dt.

    Attributes:
        steps: number N of time steps.
        turn: number of angles of a whole turn.
        rate_max: greatest rate of the vehicle [rad/s].
        stride: chains may pass hoops at every such instant; a divisor of `steps`.
        duration: duration [s]; None for the one in which the vehicle turns by exactly one angle in dt.
    """

    steps: int
    turn: int
    rate_max: float
    stride: int = 1
    duration: float | None = None

    @property
    def cell(self) -> float:
        """Time between two instants at which chains may pass hoops [s]."""
        return self.stride * self.dt

    @property
    def angle(self) -> float:
        """Angle d between neighbouring grid angles [rad]."""
        return 2 * math.pi / self.turn

    @property
    def dt(self) -> float:
        """Time step [s]."""
        return self.angle / self.rate_max if self.duration is None else self.duration / self.steps

    @property
    def time(self) -> float:
        """Duration T [s], rounded downwards."""
        return self.steps * self.dt * (1 - 8 * UNIT_ROUNDOFF) if self.duration is None else self.duration

    @property
    def valid(self) -> bool:
        """Whether the vehicle turns by at most one angle in dt."""
        return self.duration is None or self.rate_max * self.dt <= self.angle


@dataclass(frozen=True)
class HoldGrid:
    """Instants t_k = k dt that divide environment steps into equal parts, and angles that divide a turn.

    Attributes:
        steps: number N of instants after the first; a multiple of `parts`.
        turn: number of angles of a whole turn.
        rate_max: greatest rate of the vehicle [rad/s].
        parts: instants in one environment step.
        step: length of an environment step [s].
    """

    steps: int
    turn: int
    rate_max: float
    parts: int
    step: float

    @property
    def stride(self) -> int:
        """Chains may pass hoops at all instants."""
        return 1

    @property
    def cell(self) -> float:
        """Time between two instants at which chains may pass hoops [s]."""
        return self.dt

    @property
    def angle(self) -> float:
        """Angle d between neighbouring grid angles [rad]."""
        return 2 * math.pi / self.turn

    @property
    def dt(self) -> float:
        """Time between instants [s]."""
        return self.step / self.parts

    @property
    def time(self) -> float:
        """Duration T [s]."""
        return self.steps // self.parts * self.step

    @property
    def reach(self) -> int:
        """Angles by which the vehicle turns in one environment step at most, rounded upwards."""
        return math.ceil(self.rate_max * self.step / self.angle * (1 + 8 * UNIT_ROUNDOFF))


def hold_grid(count: int, step: float, rate_max: float, *, reach: int, parts: int) -> HoldGrid:
    """Return a grid for a number of environment steps.

    A step turns the vehicle by a number of angles that is not whole, and the programme rounds it upwards. The number of
    angles is chosen so that this relaxes the rate least.

    Args:
        count: number of environment steps.
        step: length of an environment step [s].
        rate_max: greatest rate of the vehicle [rad/s].
        reach: least number of angles by which a step turns the vehicle.
        parts: instants in one environment step.
    """
    turned = rate_max * step
    turns = [math.floor(2 * math.pi * n / turned) for n in range(reach, round(reach * (1 + REACH_RANGE)) + 1)]
    grids = [HoldGrid(count * parts, turn, rate_max, parts, step) for turn in turns]
    return min(grids, key=lambda grid: grid.reach * grid.angle)


def time_grid(time: float, rate_max: float, *, turn: int = DEFAULT_ANGLES, cell: float = 0.0) -> TimeGrid:
    """Return a grid of a given duration.

    The programme permits one angle in a time step. The number of angles is chosen so that this relaxes the rate least.

    Args:
        time: the given time [s].
        rate_max: greatest rate of the vehicle [rad/s].
        turn: least number of angles of one turn.
        cell: time between two instants at which chains may pass hoops, rounded to one or more time steps [s].
    """
    grids = []
    turn = max(turn, math.ceil(LEAST_STEPS * 2 * math.pi / (time * rate_max)))
    for angles in range(turn, round(turn * (1 + ANGLE_RANGE)) + 1):
        step = 2 * math.pi / angles / rate_max
        stride = max(1, round(cell / step))
        steps = stride * math.ceil(max(2.0, time / step * (1 + 16 * UNIT_ROUNDOFF)) / stride)
        grids.append(TimeGrid(steps, angles, rate_max, stride, time))
    return min(grids, key=lambda grid: grid.angle / grid.dt)


def angles_for(gap: float) -> int:
    """Return the angles of a turn for a gap.

    The interpolation error decreases with the square of the angle. It is a small share of the gap.
    """
    return max(100, math.ceil(DEFAULT_ANGLES * math.sqrt(1e-3 / gap)))
