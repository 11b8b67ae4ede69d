"""The chains of one stage: stations, windows of the passing instants, weights, and the terms beside the sweeps.

With the stations 0..m+1 at s_i and places p_i relative to the start, S = s_i - s_(i-1), w = lambda_i - lambda_(i-1) and
sigma = w/S, the value of a chain is the sum over its segments of the reward of the tilts under the weight q, which is
linear from lambda_(i-1) to lambda_i plus (0, h), of sigma . (p_i - p_(i-1)), and of n |w| (A/S + D/S^3) cell^2/4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.proof.independent.physics import MARGIN, ends_allowed, speed_bound
from optimal.proof.independent.reading import Claimed, Stage

Integers = NDArray[np.int64]
ROUNDING = 2.0**-53
LEAST_CELLS = 4
"""Fewest cells between two stations, by the theorem of the chain."""


class Invalid(ValueError):
    """A stage does not belong to the proof."""


@dataclass(frozen=True)
class Known:
    """What is known of the flights: windows of the passing times (H, 2), times between hoops (H - 1, 2) [s]."""

    windows: Array
    durations: Array

    def of(self, hoops: tuple[int, ...]) -> Known:
        """Return what is known of some hoops."""
        sums = [self.durations[i:j].sum(axis=0) for i, j in pairwise(hoops)]
        return Known(self.windows[list(hoops)].reshape(-1, 2), np.array(sums).reshape(-1, 2))

    def cut(self, hoops: tuple[int, ...], windows: Array, durations: Array) -> Known:
        """Return the intersection with what is left of some hoops."""
        new, between = self.windows.copy(), self.durations.copy()
        for hoop, (low, high) in zip(hoops, windows, strict=True):
            new[hoop] = max(new[hoop, 0], low), min(new[hoop, 1], high)
        for (i, j), (low, high) in zip(pairwise(hoops), durations, strict=True):
            if j == i + 1:
                between[i] = max(between[i, 0], low), min(between[i, 1], high)
        return Known(new, between)


class Chains:
    """The chains of a stage, for what is known of the passing times; Invalid if the stage is not one of the proof.

    Attributes:
        windows: first and last passing instant of each station, shape (m + 2, 2).
        between: least and greatest number of instants between consecutive stations, shape (m + 1, 2).
        weights: lambda, shape (m + 2, 2).
        common: (0, h) at the instants, shape (N + 1, 2).
        places: both ends of each gap relative to the start, shape (m + 2, 2, 2).
        shared: terms that all chains share, and the bound of the rounding errors.
        first, last: penalties of the first and the last tilt, for one angle of the grid.
    """

    def __init__(self, claimed: Claimed, stage: Stage, known: Known) -> None:
        scenario, self.stage, self.claimed = claimed.scenario, stage, claimed
        self.count = count = stage.steps
        self._check_grid()
        self.angle = 2 * math.pi / stage.turn
        self.dt = self._time_step()
        self.length, self.cell = count * self.dt, stage.stride * self.dt
        self.delay = self.length - claimed.time
        own = known.of(stage.hoops)
        self.places, self._sizes = gaps(scenario, stage.hoops)
        self._far, near, ways = distances(self.places, self._sizes, ends_allowed(claimed.tolerance)[0])
        self._least = self._least_times(near, ways, own.windows)
        if stage.hoops:
            ends = own.windows[0, 0], claimed.time - own.windows[-1, 1]
            self._least = np.maximum(self._least, [ends[0], *own.durations[:, 0], ends[1]])
        if stage.hoops and not (self._least >= LEAST_CELLS * self.cell).all():
            raise Invalid("stations are too close for the theorem of the chain")
        self._set_windows(own)
        self._set_weights()
        self.curvature = self._curvature()
        self.rounding = self._rounding()

    def _check_grid(self) -> None:
        stage, claimed = self.stage, self.claimed
        q, hoops = claimed.scenario.quadrotor, stage.hoops
        if stage.rate_max != q.rate_max or stage.turn < 3 or stage.steps < 2 or stage.stride < 1:
            raise Invalid("its grid is not one of this vehicle")
        if stage.steps % stage.stride or any(a >= b for a, b in pairwise(hoops)):
            raise Invalid("its grid or its hoops are not in order")
        if any(not 0 <= hoop < len(claimed.scenario.hoops) for hoop in hoops):
            raise Invalid("it names hoops that the scenario has not")
        if stage.parts:
            if stage.step != claimed.scenario.dt or not 0 < claimed.steps * stage.parts == stage.steps:
                raise Invalid("its grid is not of the environment's steps")
        elif stage.duration is not None and stage.duration < claimed.time:
            raise Invalid("its grid is shorter than the excluded time")

    def _time_step(self) -> float:
        stage = self.stage
        if stage.parts:
            return stage.step / stage.parts
        dt = self.angle / stage.rate_max if stage.duration is None else stage.duration / stage.steps
        short = dt * stage.steps < self.claimed.time * (1 - 4 * ROUNDING)
        if short or stage.rate_max * dt > self.angle * (1 + ROUNDING):
            raise Invalid("its grid is too coarse or too short")
        return dt

    def _least_times(self, near: Array, ways: Array, windows: Array) -> Array:
        """Return lower bounds of the times between stations: the least distance at the greatest possible speed [s]."""
        q, time = self.claimed.scenario.quadrotor, self.claimed.time
        position, speed = ends_allowed(self.claimed.tolerance)
        rest = speed / (q.thrust_max - q.gravity)  # to come to rest after the end
        early, late = [*windows[:, 1], time], [0.0, *windows[:, 0]]
        found = np.zeros(len(near))
        margin = MARGIN * float(self._sizes.max())
        for i, (distance, way) in enumerate(zip(near, ways, strict=True)):
            if distance <= 0:
                continue
            unit = way / np.hypot(*way)
            along = (self.places[i : i + 2] @ unit).ravel()
            goal = float(self.places[-1, 0] @ unit) + position + speed * rest
            pull = q.gravity * unit[1]
            v = speed_bound(
                q.thrust_max - pull,
                q.thrust_max + pull,
                before=float(along.max()) + margin,
                after=goal - float(along.min()) + margin,
                early=early[i],
                late=time + rest - late[i],
                time=time + rest,
            )
            found[i] = distance / (v * (1 + MARGIN)) if v > 0 else time
        return found

    def _set_windows(self, known: Known) -> None:
        """Round what is known outwards to instants at the ends of cells."""
        stride, cells, margin = self.stage.stride, self.count // self.stage.stride, MARGIN * self.count
        low, high = ((known.windows + self.delay) / self.cell).T
        low, high = np.maximum(np.floor(low - margin), 1), np.minimum(np.ceil(high + margin), cells - 1)
        inner = stride * np.stack([low, high], axis=-1).astype(np.int64)
        self.windows = np.vstack([[[0, 0]], inner, [[self.count, self.count]]])
        low, high = (known.durations / self.cell).T
        most = np.minimum(np.floor(high + 2 + margin), cells)
        apart = stride * np.stack([np.maximum(np.ceil(low - 2 - margin), 1), most], axis=-1).astype(np.int64)
        every = np.array([[stride, self.count]])
        self.between = np.vstack([every, apart, every]) if len(self.stage.hoops) else every

    def _set_weights(self) -> None:
        """Read the multipliers: lambda of each station, kappa of floor and ceiling kinks, the two penalties."""
        scenario, y = self.claimed.scenario, self.stage.multipliers
        vectors, q = 2 * (len(self.stage.hoops) + 2), scenario.quadrotor
        sides = ((1.0, scenario.floor), (-1.0, scenario.ceiling))
        limits = [(sign, height) for sign, height in sides if height is not None]
        signs = np.repeat([sign for sign, _ in limits], len(self.claimed.kinks))
        heights = np.repeat([height - scenario.start[1] for _, height in limits], len(self.claimed.kinks))
        if y.shape != (vectors + len(signs) + 2,) or not np.isfinite(y).all() or (y[vectors:] < 0).any():
            raise Invalid("its multipliers are too few, too many, infinite or negative")
        self.weights, kappa = y[:vectors].reshape(-1, 2), signs * y[vectors:-2]
        stages = self.count // max(self.stage.parts, 1)
        kinks = np.tile(np.rint(np.array(self.claimed.kinks) * stages) / stages, len(limits))
        self.common = np.zeros((self.count + 1, 2))
        instants = np.arange(self.count + 1) / self.count
        for each, kink in zip(kappa, kinks, strict=True):
            self.common[:, 1] += each * np.maximum(instants - kink, 0.0)
        self.tail = float(kappa.sum()) / self.length
        scale = q.thrust_max / q.rate_max
        first, last = scale * y[-2], scale * y[-1]
        self.first, self.last = first * self.angle, last * self.angle
        _, speed = ends_allowed(self.claimed.tolerance)
        slack = self.claimed.tolerance.angle if self.claimed.tolerance else 0.0
        sampling = 0.0 if self.stage.parts else self.angle / 2
        self.shared = float(kappa @ (self.places[-1, 0, 1] - heights)) / self.length
        self.shared += speed * float(np.hypot(*(self.weights[-1] + self.common[-1])))
        self.shared += first * sampling + last * (slack + sampling)
        self._kappa, self._penalties = float(np.abs(kappa).sum()), first + last
        self._height = float(np.abs(heights).max(initial=0.0))

    def _curvature(self) -> Array:
        """Return n (A/S + D/S^3) cell^2/4 by segment and number of cells between its ends, shape (m + 1, cells + 1)."""
        q, segments = self.claimed.scenario.quadrotor, len(self._least)
        cells = np.arange(self.count // self.stage.stride + 1)
        found = np.zeros((segments, len(cells)))
        for i in range(segments) if segments > 1 else ():
            shortest = np.maximum((cells - 2) * self.cell, self._least[i] - 2 * self.cell)
            ends = (i > 0) + (i < segments - 1)
            found[i] = ends * ((q.thrust_max + q.gravity) / shortest + self._far[i] / shortest**3) * self.cell**2 / 4
        return found

    def constants(self, i: int, begin: Integers, end: Integers) -> tuple[Array, Array]:
        """Return the slopes sigma (n, 2) of segments from station i, and their terms without tilt and gap (n,)."""
        jump, duration = self.weights[i + 1] - self.weights[i], (end - begin) * self.dt
        slope = jump / duration[:, None]
        terms = float(np.hypot(*jump)) * self.curvature[i, (end - begin) // self.stage.stride]
        if i == len(self.weights) - 2:
            position, _ = ends_allowed(self.claimed.tolerance)
            terms = terms + slope @ self.places[-1, 0] + position * np.hypot(slope[:, 0], slope[:, 1] + self.tail)
        return slope, terms

    def pairs(self, i: int) -> tuple[Integers, Integers]:
        """Return all pairs of instants of station i and the next one, by ascending first instant."""
        stride, (low, high) = self.stage.stride, self.windows[i + 1]
        least, most = self.between[i]
        found = [
            (begin, end)
            for begin in range(self.windows[i, 0], self.windows[i, 1] + 1, stride)
            for end in range(max(low, begin + least), min(high, begin + most) + 1, stride)
        ]
        begin, end = np.array(found, dtype=np.int64).reshape(-1, 2).T
        return begin, end

    def _rounding(self) -> float:
        """Return a bound of all rounding errors: units in the last place of the sum of all magnitudes."""
        q, (position, speed) = self.claimed.scenario.quadrotor, ends_allowed(self.claimed.tolerance)
        lengths = np.abs(self.weights).sum(axis=1)
        weight = float(lengths.max()) + self._kappa
        bulge = self.angle**2 / 8 * q.thrust_max
        size = 2 * self.length * (q.thrust_max + q.gravity + bulge) * weight + speed * weight
        size += self._penalties * (q.rate_max * self.length * 2 + 4 * math.pi * (2 + self.count / self.stage.turn))
        least = np.maximum(self.windows[1:, 0] - self.windows[:-1, 1], self.between[:, 0]) * self.dt
        reach = self._sizes[1:] + self._sizes[:-1] + position
        size += float(((lengths[1:] + lengths[:-1]) * (reach / least + self.curvature.max(axis=1))).sum())
        size += self._kappa * (self._height + 2 * float(self._sizes[-1]) + position) / self.length
        return 8 * (self.count + 1000) * ROUNDING * size


def gaps(scenario: Scenario, hoops: tuple[int, ...]) -> tuple[Array, Array]:
    """Return both ends of each gap relative to the start, shape (m + 2, 2, 2), and the size of their coordinates."""
    start, found, sizes = np.array(scenario.start), [], []
    ends = [(start, start)]
    for hoop in (scenario.hoops[i] for i in hoops):
        half = (hoop.diameter / 2 - scenario.quadrotor.radius) * np.array([-math.sin(hoop.angle), math.cos(hoop.angle)])
        ends.append((np.array([hoop.x, hoop.z]) - half, np.array([hoop.x, hoop.z]) + half))
    ends.append((np.array(scenario.goal), np.array(scenario.goal)))
    for one, other in ends:
        found.append([one - start, other - start])
        sizes.append(np.abs(one).sum() + np.abs(other).sum() + np.abs(start).sum() + np.hypot(*(one - other)))
    return np.array(found), np.array(sizes)


def distances(places: Array, sizes: Array, slack: float) -> tuple[Array, Array, Array]:
    """Return the greatest and least distance of consecutive gaps, rounded outwards, and the shortest vectors."""
    error = MARGIN * (sizes[:-1] + sizes[1:])
    end = np.zeros(len(places) - 1)
    end[-1] = slack
    far = np.array([max(np.hypot(*(b - a)) for a in one for b in other) for one, other in pairwise(places)])
    ways = np.array([_shortest(one, other) for one, other in pairwise(places)])
    near = np.hypot(ways[:, 0], ways[:, 1]) - end - error
    return far + end + error, np.maximum(near, 0.0), ways


def _shortest(one: Array, other: Array) -> Array:
    """Return the shortest vector from one segment to another, zero where they cross."""
    (a, b), (c, d) = one, other
    sides = [_side(a, b, c), _side(a, b, d), _side(c, d, a), _side(c, d, b)]
    if sides[0] * sides[1] < 0 and sides[2] * sides[3] < 0:
        return np.zeros(2)
    ways = [_foot(a, c, d) - a, _foot(b, c, d) - b, c - _foot(c, a, b), d - _foot(d, a, b)]
    return min(ways, key=lambda way: float(np.hypot(*way)))


def _side(a: Array, b: Array, p: Array) -> float:
    return float((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]))


def _foot(p: Array, a: Array, b: Array) -> Array:
    """Return the point of the segment from a to b that is nearest to p."""
    length = float((b - a) @ (b - a))
    share = min(max(float((p - a) @ (b - a)) / length, 0.0), 1.0) if length > 0 else 0.0
    return np.asarray(a + share * (b - a))
