"""The stations of a chain: start, hoops and goal, the distances between them, and the windows of the passing times.

A window is an interval of the time [s] at which a flight of duration T passes a hoop. Its cells are the times between
neighbouring instants at which chains may pass hoops. A grid that is longer than T
bounds the same flights, because they may hover until they fill it. Their passing times are then later by the
difference.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario, Tolerance
from optimal.flights.projection_bound import greatest_speed, passing_windows
from optimal.proof.programme.rounding import TIME_MARGIN
from optimal.proof.programme.tilt_program import Grid, Integers

Interval = tuple[float, float]
STEPS_APART = 4
"""Fewest cells between two stations of a chain."""


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
        ways: shortest vectors between them, shape (m+1, 2).

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
        self.ways = np.array([shortest_way(*pair) for pair in pairs])
        self.near = np.maximum(np.hypot(*self.ways.T) - slack - error, 0.0)

    def least_times(self, problem: Problem, windows: Sequence[Interval]) -> Array:
        """Return lower bounds of the times between consecutive stations [s], shape (m+1,).

        A flight covers the least distance of two stations along a direction at some instant at least at the mean speed,
        and the projection bound limits this speed.

        Args:
            problem: the flights.
            windows: windows of the passing times of the hoops of the chain [s].
        """
        vehicle = problem.scenario.quadrotor
        allowance = problem.speed / (vehicle.thrust_max - vehicle.gravity)
        duration = problem.duration + allowance  # to come to rest after the end
        reach = problem.position + problem.speed * allowance
        first, last = [0.0, *(low for low, _ in windows)], [*(high for _, high in windows), problem.duration]
        found = []
        for i, (way, near) in enumerate(zip(self.ways, self.near, strict=True)):
            length = float(np.hypot(*way))
            if near == 0 or length == 0:
                found.append(0.0)
                continue
            along = way / length
            pull = vehicle.gravity * along[1]
            covered, end = (self.places[i : i + 2] @ along).ravel(), float(self.places[-1, 0] @ along)
            margin = TIME_MARGIN * float(self.size.max())
            before = (float(covered.min()) - margin, float(covered.max()) + margin)
            after = (end - before[1] - reach, end - before[0] + reach)
            limits = (last[i], duration - first[i], duration)
            speed = greatest_speed((vehicle.thrust_max - pull, vehicle.thrust_max + pull), before, after, limits)
            # Without time to move no flight passes both stations.
            found.append(near / (speed * (1 + TIME_MARGIN)) if speed > 0 else duration)
        return np.array(found)


def hoops_apart(problem: Problem, grid: Grid, hoops: Sequence[int], passing: Passing) -> tuple[int, ...]:
    """Return the hoops without those that are too close to the station before them, or to the goal, for a grid."""

    def apart(chain: tuple[int, ...]) -> list[bool]:
        return (least_times(problem, chain, passing.of(chain)) >= STEPS_APART * grid.cell).tolist()

    found: tuple[int, ...] = ()
    for hoop in hoops:
        if apart((*found, hoop))[-2]:
            found = (*found, hoop)
    while found and not apart(found)[-1]:
        found = found[:-1]
    return found


def least_times(problem: Problem, hoops: Sequence[int], passing: Passing) -> Array:
    """Return lower bounds of the times between consecutive stations of a chain, by physics and by what is known [s].

    Args:
        problem: the flights.
        hoops: the hoops of the chain.
        passing: what is known of the passing times of these hoops.
    """
    found = Stations(problem, hoops).least_times(problem, passing.windows)
    if passing.windows:
        known = [
            passing.windows[0][0],
            *(low for low, _ in passing.durations),
            problem.duration - passing.windows[-1][1],
        ]
        found = np.maximum(found, known)
    return found


def shortest_way(one: Array, other: Array) -> Array:
    """Return the shortest vector from one line segment to another, each given by its ends, shape (2, 2)."""
    (a, b), (c, d) = one, other
    along, across = b - a, d - c
    det = along[0] * across[1] - along[1] * across[0]
    if det != 0:
        way = c - a
        share = (way[0] * across[1] - way[1] * across[0]) / det
        there = (way[0] * along[1] - way[1] * along[0]) / det
        if 0 <= share <= 1 and 0 <= there <= 1:
            return np.zeros(2)
    ways = [_way(a, other), _way(b, other), -_way(c, one), -_way(d, one)]
    return min(ways, key=lambda way: float(way @ way))


def _way(point: Array, segment: Array) -> Array:
    """Return the shortest vector from a point to a line segment."""
    way = segment[1] - segment[0]
    length = float(way @ way)
    share = min(max(float((point - segment[0]) @ way) / length, 0.0), 1.0) if length > 0 else 0.0
    return np.asarray(segment[0] + share * way - point)


@dataclass(frozen=True)
class Passing:
    """What is known of the passing times of all flights of duration T.

    Attributes:
        windows: for each hoop, an interval that contains its passing time [s].
        durations: for each two consecutive hoops, an interval that contains the time between them [s].
    """

    windows: tuple[Interval, ...]
    durations: tuple[Interval, ...]

    @classmethod
    def possible(cls, problem: Problem) -> Passing:
        """Return what the projection bound says."""
        shares = passing_windows(problem.scenario, problem.duration, problem.tolerance)
        windows = tuple((low * problem.duration, high * problem.duration) for low, high in shares)
        return cls(windows, ((0.0, problem.duration),) * max(len(windows) - 1, 0))

    def of(self, hoops: Sequence[int]) -> Passing:
        """Return what is known of a chain through some hoops."""
        durations = []
        for i, j in pairwise(hoops):
            low, high = zip(*self.durations[i:j], strict=True)
            durations.append((sum(low), sum(high)))
        return Passing(tuple(self.windows[i] for i in hoops), tuple(durations))

    def cut(self, hoops: Sequence[int], left: Passing) -> Passing:
        """Return the intersection with what is left for a chain through some hoops."""
        windows, durations = list(self.windows), list(self.durations)
        for hoop, interval in zip(hoops, left.windows, strict=True):
            windows[hoop] = _intersection(windows[hoop], interval)
        for (i, j), interval in zip(pairwise(hoops), left.durations, strict=True):
            if j == i + 1:
                durations[i] = _intersection(durations[i], interval)
        return Passing(tuple(windows), tuple(durations))


def _intersection(one: Interval, other: Interval) -> Interval:
    return max(one[0], other[0]), min(one[1], other[1])


def to_instants(passing: Passing, problem: Problem, grid: Grid) -> tuple[Integers, Integers]:
    """Return the first and last instant of each window, and the least and greatest number of instants between hoops.

    The corners of the cells of a flight that passes two hoops at a distance S differ by between S/cell - 2 and
    S/cell + 2 cells.

    Returns:
        Multiples of the cell, shapes (m, 2) and (m-1, 2).
    """
    cells, margin = grid.steps // grid.stride, TIME_MARGIN * grid.steps
    low, high = np.array(passing.windows).reshape(-1, 2).T / grid.cell + _delay(problem, grid) / grid.cell
    windows = np.column_stack([np.floor(low - margin), np.ceil(high + margin)])
    windows = np.clip(windows, [1, 0], [cells, cells - 1])
    low, high = np.array(passing.durations).reshape(-1, 2).T / grid.cell
    durations = np.column_stack([np.ceil(low - 2 - margin), np.floor(high + 2 + margin)])
    durations = np.clip(durations, 1, cells)
    return grid.stride * windows.astype(np.int64), grid.stride * durations.astype(np.int64)


def to_times(windows: Integers, durations: Integers, problem: Problem, grid: Grid) -> Passing:
    """Return what is known where chains are left in these windows with these numbers of instants between the hoops."""
    delay, dt, two = _delay(problem, grid), grid.dt, 2 * grid.cell
    return Passing(
        tuple((float(low * dt - delay), float(high * dt - delay)) for low, high in windows),
        tuple((float(max(low * dt - two, 0.0)), float(high * dt + two)) for low, high in durations),
    )


def _delay(problem: Problem, grid: Grid) -> float:
    """Return the time by which a flight of duration T hovers first on a grid [s]."""
    return grid.steps * grid.dt - problem.duration
