"""The dual of time-optimal flight: multipliers that exclude all flights of a given time.

F of `chain` is convex and positively homogeneous in all multipliers. If F < 0 for one set of multipliers,
no flight of the class takes the time of the grid. No flight takes less either, because it could hover first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import NamedTuple, TypeVar

import numpy as np

from flatgym.quadrotor import Array
from optimal.proof.branches import Branch
from optimal.proof.chain_terms import NOTHING, ChainTerms, unit
from optimal.proof.programme.chain import Chain, best_chain, best_through, best_values, reverse_time
from optimal.proof.programme.stations import Passing, Problem, to_times
from optimal.proof.programme.tilt_program import Grid, Integers, gradient
from optimal.proof.programme.zero_order_hold import hold_gradient

ResultT = TypeVar("ResultT")
TILT_SHARES = (0.25, 0.5, 0.75)
"""Instants at which the tilt may be split, as shares of T."""


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


class Dual(ChainTerms):
    """F of one problem, grid, branch, and knowledge of the passing times; arguments as in `ChainTerms`."""

    def __init__(
        self,
        problem: Problem,
        grid: Grid,
        branch: Branch,
        hoops: Sequence[int] = (),
        passing: Passing = NOTHING,
    ) -> None:
        super().__init__(problem, grid, branch, hoops, passing)
        self._values: list[Array] = []
        self._last: tuple[Array, Evaluation] | None = None

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
            past, values, choices = np.empty_like(self._values[begin]), self._values[begin], self._choices[begin]
            best_values(1 - begin, backward, backward_tilts, self._limits, past, np.empty_like(choices))
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
            way += chain.curvature[i, (passing[i + 1] - passing[i]) // chain.stride] * unit(jump)
            if i == chain.goal:
                disc = chain.position * unit(jump / duration + [0.0, chain.tail])
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


@lru_cache(maxsize=1)
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "programme")
