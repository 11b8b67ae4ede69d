"""The stations of a chain: start, hoops and goal, the distances between them, and the windows of the passing times.

A window is an interval of the time [s] at which a flight of duration T passes a hoop. A grid that is longer than T
bounds the same flights, because they may hover until they fill it. Their passing times are then later by the
difference.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario, Tolerance
from optimal.flights.projection_bound import passing_windows
from optimal.proof.rounding import TIME_MARGIN
from optimal.proof.tilt_program import Grid, Integers

Interval = tuple[float, float]
STEPS_APART = 4
"""Fewest time steps between two stations of a chain."""


@dataclass(frozen=True)
class Problem:
    """The flights that a proof excludes.

    Attributes:
        scenario: the task.
        tolerance: goal tolerance; None requires exact rest at the goal.
        duration: duration T of the flights [s].
        kinks: times at which the slope of q may jump at floor and ceiling, as shares of the grid's duration.
        steps: number of environment steps, if controls are held over steps; 0 if they may change at any time.
    """

    scenario: Scenario
    tolerance: Tolerance | None
    duration: float
    kinks: tuple[float, ...] = ()
    steps: int = 0

    @property
    def hoops(self) -> tuple[int, ...]:
        """All hoops."""
        return tuple(range(len(self.scenario.hoops)))

    @property
    def slack(self) -> float:
        """Greatest deviation of the last tilt from a whole number of turns [rad]."""
        return self.tolerance.angle if self.tolerance else 0.0

    @property
    def position(self) -> float:
        """Greatest distance to the goal at the end [m]."""
        return self.tolerance.position if self.tolerance else 0.0

    @property
    def speed(self) -> float:
        """Greatest speed at the end [m/s]."""
        return self.tolerance.speed if self.tolerance else 0.0


class Stations:
    """Places and distances of the stations of a chain.

    Attributes:
        places: both ends of each gap relative to the start, shape (m+2, 2, 2).
        size: bound of the magnitudes from which the coordinates of each station are computed, shape (m+2,).
        far, near: greatest and least distance between places of consecutive stations, shape (m+1,).

    Args:
        problem: the flights.
        hoops: the hoops of the chain, ascending.
    """

    def __init__(self, problem: Problem, hoops: Sequence[int]) -> None:
        scenario = problem.scenario
        start, goal = np.array(scenario.start), np.array(scenario.goal)
        gaps = [np.array([start, start])]
        for hoop in (scenario.hoops[i] for i in hoops):
            aside = hoop.half_gap(scenario.quadrotor.radius) * hoop.across
            gaps.append(np.array([hoop.centre - aside, hoop.centre + aside]))
        gaps.append(np.array([goal, goal]))
        self.places = np.array(gaps) - start
        self.size = np.abs(gaps).sum(axis=2).max(axis=1) + np.abs(start).sum()
        self.size[1:-1] += [scenario.hoops[i].diameter for i in hoops]
        pairs = list(zip(self.places[:-1], self.places[1:], strict=True))
        slack = np.append(np.zeros(len(pairs) - 1), problem.position)
        error = TIME_MARGIN * (self.size[:-1] + self.size[1:])
        self.far = np.array([max(math.dist(a, b) for a in one for b in other) for one, other in pairs]) + slack + error
        self.near = np.maximum([segment_distance(*pair) for pair in pairs] - slack - error, 0.0)

    def least_times(self, problem: Problem, grid: Grid) -> Array:
        """Return lower bounds of the times between consecutive stations [s], shape (m+1,)."""
        vehicle = problem.scenario.quadrotor
        return self.near / greatest_speed(vehicle.thrust_max + vehicle.gravity, grid, problem)


def greatest_speed(acceleration: float, grid: Grid, problem: Problem) -> float:
    """Return an upper bound of the speed of a flight that starts at rest and ends with the tolerance's speed [m/s]."""
    return (acceleration * grid.steps * grid.dt + problem.speed) / 2 * (1 + TIME_MARGIN)


def hoops_apart(problem: Problem, grid: Grid, hoops: Sequence[int]) -> tuple[int, ...]:
    """Return the hoops without those that are too close to the station before them, or to the goal, for a grid."""
    found: tuple[int, ...] = ()
    for hoop in hoops:
        if Stations(problem, (*found, hoop)).least_times(problem, grid)[-2] >= STEPS_APART * grid.dt:
            found = (*found, hoop)
    while found and Stations(problem, found).least_times(problem, grid)[-1] < STEPS_APART * grid.dt:
        found = found[:-1]
    return found


def segment_distance(one: Array, other: Array) -> float:
    """Return the least distance of two line segments, each given by its ends, shape (2, 2)."""
    (a, b), (c, d) = one, other
    along, across = b - a, d - c
    det = along[0] * across[1] - along[1] * across[0]
    if det != 0:
        way = c - a
        share = (way[0] * across[1] - way[1] * across[0]) / det
        there = (way[0] * along[1] - way[1] * along[0]) / det
        if 0 <= share <= 1 and 0 <= there <= 1:
            return 0.0
    return min(_point_distance(*pair) for pair in ((a, other), (b, other), (c, one), (d, one)))


def _point_distance(point: Array, segment: Array) -> float:
    """Return the distance of a point from a line segment."""
    way = segment[1] - segment[0]
    length = float(way @ way)
    share = min(max(float((point - segment[0]) @ way) / length, 0.0), 1.0) if length > 0 else 0.0
    return math.dist(segment[0] + share * way, point)


Windows = tuple[Interval, ...]
"""For each hoop, the interval of its passing time in flights of duration T [s]."""


def possible_windows(problem: Problem) -> Windows:
    """Return windows that contain the passing times of all flights, by the argument of the projection bound."""
    shares = passing_windows(problem.scenario, problem.duration, problem.tolerance)
    return tuple((low * problem.duration, high * problem.duration) for low, high in shares)


def to_instants(windows: Sequence[Interval], problem: Problem, grid: Grid) -> Integers:
    """Return the first and last instant of each window on a grid, rounded outwards, shape (m, 2)."""
    margin = TIME_MARGIN * grid.steps
    found = np.array(windows, dtype=np.float64).reshape(-1, 2) / grid.dt + _delay(problem, grid) / grid.dt
    found = np.column_stack([np.floor(found[:, 0] - margin), np.ceil(found[:, 1] + margin)])
    return np.clip(found, [1, 0], [grid.steps, grid.steps - 1]).astype(np.int64)


def to_times(instants: Integers, problem: Problem, grid: Grid) -> list[Interval]:
    """Return windows of instants on a grid as intervals of the time [s]; `to_instants` allows for the rounding."""
    delay = _delay(problem, grid)
    return [(float(low * grid.dt - delay), float(high * grid.dt - delay)) for low, high in instants]


def _delay(problem: Problem, grid: Grid) -> float:
    """Return the time by which a flight of duration T hovers first on a grid [s]."""
    return grid.steps * grid.dt - problem.duration
