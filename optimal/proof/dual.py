"""The dual of time-optimal flight: multipliers that exclude all flights of a given time.

F of `optimal.proof.chain` is convex and positively homogeneous in all multipliers. If F < 0 for one set of multipliers,
no flight of the class takes the time of the grid. No flight takes less either, because it could hover first.

Rounding. The magnitudes of the terms of one chain sum to at most B. Each term is off by at most 64 units in the last
place of its magnitude: durations and angles are products of a few numbers, and a weight is a sum of multipliers times
shares of at most 1. A sum of N terms is off by at most N units of B. The computed F is the value of the chain that is
best in floating-point arithmetic, hence at least the computed value of the chain that is truly best. The bound is twice
(N + ROUNDING_UNITS) units of B.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import NamedTuple, TypeVar

import numpy as np

from flatgym.quadrotor import Array
from optimal.proof.branches import Branch
from optimal.proof.chain import Chain, best_chain, best_through, best_values, first_rows, reverse_time
from optimal.proof.rounding import LEAST_LENGTH, UNIT_ROUNDOFF
from optimal.proof.stations import STEPS_APART, Passing, Problem, Stations, least_times, to_instants, to_times
from optimal.proof.tilt_program import Grid, Integers, gradient, limits, tilts
from optimal.proof.time_grid import HoldGrid
from optimal.proof.zero_order_hold import hold_gradient

TILT_SHARES = (0.25, 0.5, 0.75)
"""Instants at which the tilt may be split, as shares of T."""
ROUNDING_UNITS = 256
"""Rounding error of all terms but the sum over the samples, in units in the last place of their magnitudes."""


NOTHING = Passing((), ())
"""What is known of the passing times of no hoops."""
ResultT = TypeVar("ResultT")


class Cut(NamedTuple):
    """A cutting plane of F: its value at some multipliers, a bound of the rounding error, and a subgradient.

    F(y) >= slope . y for all y. `chain` has the passing times of the best chain, as shares of T, and its tilts at
    TILT_SHARES [rad]; without a winding it is empty.
    """

    value: float
    rounding: float
    slope: Array
    chain: Array = np.zeros(0)


class Evaluation(NamedTuple):
    """F at some multipliers: its value, a bound of the rounding error, and the terms that all chains share."""

    value: float
    rounding: float
    shared: float


class Dual:
    """F of one problem, grid, branch, and windows of the passing times.

    The multipliers y are, in this order and all in the unit of q: lambda of each station (2 components each); kappa of
    the floor kinks and of the ceiling kinks; and the penalties of first and last tilt times rate_max/thrust_max.
    Multipliers with an index in `signed` must be nonnegative.

    Args:
        problem: the flights.
        grid: instants and angles of the dynamic programme; at least as long as the flights.
        branch: the class of flights.
        hoops: the hoops of the chain, ascending. The others are ignored.
        passing: what is known of the passing times of these hoops.
    """

    def __init__(
        self,
        problem: Problem,
        grid: Grid,
        branch: Branch,
        hoops: Sequence[int] = (),
        passing: Passing = NOTHING,
    ) -> None:
        self.problem, self.grid, self.hoops = problem, grid, tuple(hoops)
        scenario, steps = problem.scenario, grid.steps
        self._limits = limits(scenario.quadrotor, grid)
        self._tilts = tilts(grid, branch.winding, problem.slack, branch.held, problem.duration)
        self._stations = Stations(problem, hoops)
        self._least = least_times(problem, hoops, passing)
        windows, durations = to_instants(passing, problem, grid)
        self._windows = np.vstack([[[0, 0]], windows, [[steps, steps]]])
        every = [[grid.stride, steps]]
        self._durations = np.vstack([every, durations, every]) if len(hoops) else np.array(every)
        self._programmes = (0,) if isinstance(grid, HoldGrid) else (0, 1)
        stages = steps // grid.parts if isinstance(grid, HoldGrid) else steps
        at = np.rint(np.array(problem.kinks) * stages) / stages
        heights = [(1.0, scenario.floor), (-1.0, scenario.ceiling)]
        heights = [(sign, height - scenario.start[1]) for sign, height in heights if height is not None]
        self._signs = np.repeat([sign for sign, _ in heights], len(at))
        self._heights = np.repeat([height for _, height in heights], len(at))
        self._bends = np.maximum(np.arange(steps + 1)[:, None] / steps - np.tile(at, len(heights)), 0.0)
        self.vectors = 2 * (2 + len(self.hoops))
        self.size = self.vectors + len(self._signs) + 2
        self.signed = np.arange(self.vectors, self.size)
        self._scale = scenario.quadrotor.thrust_max / scenario.quadrotor.rate_max
        self._curvature = self._curvatures()
        self._values: list[Array] = []
        self._last: tuple[Array, Evaluation] | None = None

    @property
    def apart(self) -> bool:
        """Whether the stations are far enough apart for the theorem of the chain on this grid."""
        return len(self.hoops) == 0 or bool((self._least >= STEPS_APART * self.grid.cell).all())

    @property
    def possible(self) -> bool:
        """Whether the branch can contain a flight: turns take time, and hoops are passed in order."""
        low, high = self._windows.T
        ordered = (low <= high).all() and (np.maximum.accumulate(low)[:-1] < high[1:]).all()
        return self._tilts.possible and bool(ordered and (self._durations[:, 0] <= self._durations[:, 1]).all())

    def evaluate(self, y: Array) -> Evaluation:
        """Return F without its slope; the last evaluation is remembered."""
        if self._last is not None and np.array_equal(y, self._last[0]):
            return self._last[1]
        chain, first = self._chain(y)
        if not self._values:
            counts = (chain.windows[:, 1] - chain.windows[:, 0]) // chain.stride + 1
            shape = (int(counts.sum()), 2, len(self._tilts.sin))
            self._values = [np.empty(shape) for _ in self._programmes]
            self._choices = [np.empty(shape, np.int32) for _ in self._programmes]
        value = shared = self._shared(y, chain)
        inside = slice(self._tilts.low[0], self._tilts.high[0] + 1)

        def run(begin: int) -> float:
            values = self._values[begin]
            best_values(begin, chain, self._tilts, self._limits, values, self._choices[begin])
            return float((values[0, 0] - first)[inside].max())

        value += sum(self._in_threads(run)) / len(self._programmes)
        self._last = (y.copy(), Evaluation(value, self._rounding(y), shared))
        return self._last[1]

    def __call__(self, y: Array) -> Cut:
        """Return F with a subgradient."""
        found = self.evaluate(y)
        chain, first = self._chain(y)
        slope, chains = self._shared_slope(chain), [np.zeros(0)]
        if np.isfinite(found.value):
            chains = [self._add_slope(slope, begin, chain, first) for begin in self._programmes]
        return Cut(found.value, found.rounding, slope, np.mean(chains, axis=0))

    def prune(self, y: Array) -> Passing | None:
        """Return what is known of the passing times of all flights; None if no flight is left."""
        found = self.evaluate(y)
        if found.value + found.rounding < 0:
            return None
        chain, first = self._chain(y)
        backward, backward_tilts = reverse_time(chain, self._tilts, first)

        def run(begin: int) -> Array:
            past, values = np.empty_like(self._values[begin]), self._values[begin]
            best_values(1 - begin, backward, backward_tilts, self._limits, past, self._choices[begin])
            return np.asarray(best_through(begin, chain, self._tilts, self._limits, first, values, backward, past))

        total = found.shared + found.rounding + np.mean(self._in_threads(run), axis=0)
        stride, windows, durations = self.grid.stride, self._windows.copy(), self._durations.copy()
        for i, segment in enumerate(total):
            left, right = np.nonzero(segment >= 0)
            if not len(left):
                return None
            for station, at in ((i, left), (i + 1, right)):
                # A flight passes within a cell only if chains at one of its ends are left.
                low, high = self._windows[station, 0] + stride * np.array([at.min() - 1, at.max() + 1])
                windows[station] = max(windows[station, 0], low), min(windows[station, 1], high)
            apart = self._windows[i + 1, 0] - self._windows[i, 0] + stride * (right - left)
            durations[i] = apart.min(), apart.max()
        return to_times(windows[1:-1], durations[1:-1], self.problem, self.grid)

    def _in_threads(self, run: Callable[[int], ResultT]) -> list[ResultT]:
        """Return the results of a function for each programme; the kernels of both run at the same time."""
        later = [_threads().submit(run, begin) for begin in self._programmes[1:]]
        return [run(self._programmes[0]), *(future.result() for future in later)]

    def _curvatures(self) -> Array:
        """Return E_i / |w_i| by segment and difference of instants in cells, shape (m+1, N/stride + 1)."""
        cell, cells, last = self.grid.cell, self.grid.steps // self.grid.stride, len(self._least) - 1
        acceleration = self._limits.thrust_max + self._limits.gravity
        found = np.zeros((last + 1, cells + 1))
        for i in range(last + 1) if last else ():
            least = max(self._least[i] - 2 * cell, LEAST_LENGTH)
            shortest = np.maximum((np.arange(cells + 1) - 2) * cell, least)
            with np.errstate(over="ignore", divide="ignore"):
                terms = acceleration / shortest + self._stations.far[i] / shortest**3
            found[i] = ((i > 0) + (i < last)) * terms * cell**2 / 4
        return found

    def _chain(self, y: Array) -> tuple[Chain, Array]:
        """Return the terms of all chains, and the penalty of the first tilt by position."""
        kappa = self._signs * y[self.vectors : -2]
        common = np.zeros((self.grid.steps + 1, 2))
        if len(kappa):
            common[:, 1] = self._bends @ kappa
        d = self.grid.angle
        chain = Chain(
            weights=y[: self.vectors].reshape(-1, 2).copy(),
            common=common,
            windows=self._windows,
            durations=self._durations,
            stride=self.grid.stride,
            rows=first_rows(self._windows, self.grid.stride),
            places=self._stations.places,
            curvature=self._curvature,
            goal=len(self.hoops),
            position=self.problem.position,
            tail=float(kappa.sum()) / self._duration,
            final=self._scale * y[-1] * d * self._tilts.last,
        )
        return chain, self._scale * y[-2] * d * self._tilts.first

    @property
    def _duration(self) -> float:
        return self.grid.steps * self.grid.dt

    @property
    def _penalty_ends(self) -> Array:
        """Derivatives of the shared terms with respect to the penalties."""
        sampling = self.grid.angle / 2 if len(self._programmes) == 2 else 0.0
        return self._scale * np.array([sampling, self.problem.slack + sampling])

    def _shared(self, y: Array, chain: Chain) -> float:
        """Return the terms that all chains share."""
        kappa, end = self._signs * y[self.vectors : -2], chain.weights[-1] + chain.common[-1]
        heights = float(kappa @ (chain.places[-1, 0, 1] - self._heights)) / self._duration
        return heights + self.problem.speed * float(np.hypot(*end)) + float(self._penalty_ends @ y[-2:])

    def _shared_slope(self, chain: Chain) -> Array:
        """Return a subgradient of the terms that all chains share."""
        slope, end = np.zeros(self.size), chain.weights[-1] + chain.common[-1]
        push = self.problem.speed * _unit(end)
        slope[self.vectors - 2 : self.vectors] = push
        heights = (chain.places[-1, 0, 1] - self._heights) / self._duration
        slope[self.vectors : -2] = self._signs * (self._bends[-1] * push[1] + heights)
        slope[-2:] = self._penalty_ends
        return slope

    def _add_slope(self, slope: Array, begin: int, chain: Chain, first: Array) -> Array:
        """Add the share of one programme in the derivative of the mean of the best chains; return `Cut.chain`."""
        tables, limit = self._tilts, self._limits
        row = self._values[begin][0, 0] - first
        start = int(tables.low[0] + np.argmax(row[tables.low[0] : tables.high[0] + 1]))
        values, choices = self._values[begin], self._choices[begin]
        passing, ends, path = best_chain(begin, chain, tables, limit, values, choices, start)
        k = np.arange(self.grid.steps + 1)
        segment = np.minimum(np.searchsorted(passing, k, side="right") - 1, len(passing) - 2)
        left = passing[segment]
        share = ((k - left) / (passing[segment + 1] - left))[:, None]
        weight = chain.weights[segment] * (1 - share) + chain.weights[segment + 1] * share + chain.common
        if tables.hold.parts:
            reward, last = hold_gradient(passing, path, weight, tables, limit), path[-1]
        else:
            reward, last = gradient(begin, path, weight, tables, limit), path[-2]
        reward /= len(self._programmes)
        by_weight = np.zeros((len(chain.weights), 2))
        np.add.at(by_weight, segment, reward * (1 - share))
        np.add.at(by_weight, segment + 1, reward * share)
        tail = 0.0
        for i in range(len(passing) - 1):
            duration = (passing[i + 1] - passing[i]) * limit.dt
            jump = chain.weights[i + 1] - chain.weights[i]
            way = (chain.places[i + 1, ends[i + 1]] - chain.places[i, ends[i]]) / duration
            way += chain.curvature[i, (passing[i + 1] - passing[i]) // chain.stride] * _unit(jump)
            if i == chain.goal:
                disc = chain.position * _unit(jump / duration + [0.0, chain.tail])
                way += disc / duration
                tail = disc[1] / self._duration / len(self._programmes)
            by_weight[i + 1] += way / len(self._programmes)
            by_weight[i] -= way / len(self._programmes)
        slope[: self.vectors] += by_weight.ravel()
        slope[self.vectors : -2] += self._signs * (self._bends.T @ reward[:, 1] + tail)
        penalties = self._scale * self.grid.angle * np.array([tables.first[start], tables.last[last]])
        slope[-2:] -= penalties / len(self._programmes)
        return self._describe(passing, path)

    def _describe(self, passing: Integers, path: Integers) -> Array:
        """Return passing times and tilts of a chain as `Cut.chain`."""
        if self._tilts.circular:
            return np.zeros(0)
        instants = self.problem.duration / self.grid.dt
        late, whole = self.grid.steps - instants, getattr(self.grid, "parts", 1)
        at = np.minimum(np.rint((late + np.array(TILT_SHARES) * instants) / whole) * whole, self.grid.steps - 1)
        tilt = self.grid.angle * (path[at.astype(int)] - self._tilts.zero)
        return np.concatenate([(passing[1:-1] - late) / instants, tilt])

    def _rounding(self, y: Array) -> float:
        """Return a bound of the rounding error of F."""
        weights, kappa = np.abs(y[: self.vectors]).reshape(-1, 2).sum(axis=1), float(np.abs(y[self.vectors : -2]).sum())
        limit, dt, stations = self._limits, self.grid.dt, self._stations
        size = 2 * self._duration * (limit.thrust_max + limit.gravity + limit.bulge) * (float(weights.max()) + kappa)
        size += self.problem.speed * (float(weights[-1]) + kappa)
        tables, penalty = self._tilts, self._scale * np.abs(y[-2:]).sum()
        size += penalty * (self.grid.angle * (tables.first.max() + tables.last.max() + 2) + self.problem.slack)
        least = np.maximum(self._windows[1:, 0] - self._windows[:-1, 1], self._durations[:, 0]) * dt
        reach = stations.size[:-1] + stations.size[1:] + self.problem.position
        jumps = weights[1:] + weights[:-1]
        size += float((jumps * (reach / least + self._curvature.max(axis=1))).sum())
        heights = np.abs(self._heights).max(initial=0.0) + 2 * stations.size[-1] + self.problem.position
        size += kappa * heights / self._duration
        return float(2 * (self.grid.steps + ROUNDING_UNITS) * UNIT_ROUNDOFF * size)


@lru_cache(maxsize=1)
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "programme")


def _unit(vector: Array) -> Array:
    """Return a vector divided by its length; zero for zero."""
    return np.asarray(vector / max(float(np.hypot(*vector)), LEAST_LENGTH))
