"""The terms of all chains for given multipliers: weights, curvature, penalties, shared terms, and the rounding error.

Rounding. The magnitudes of the terms of one chain sum to at most B. Each term is off by at most 64 units in the last
place of its magnitude: durations and angles are products of a few numbers, and a weight is a sum of multipliers times
shares of at most 1. A sum of N terms is off by at most N units of B. The computed F is the value of the chain that is
best in floating-point arithmetic, hence at least the computed value of the chain that is truly best. The bound is twice
(N + ROUNDING_UNITS) units of B.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flatgym.quadrotor import Array
from optimal.proof.branches import Branch
from optimal.proof.programme.chain import Chain, first_rows
from optimal.proof.programme.point_mass import pairs_left
from optimal.proof.programme.rounding import LEAST_LENGTH, UNIT_ROUNDOFF
from optimal.proof.programme.stations import STEPS_APART, Passing, Problem, Stations, least_times, to_instants
from optimal.proof.programme.tilt_program import Grid, limits, tilts
from optimal.proof.programme.time_grid import HoldGrid

NOTHING = Passing((), ())
"""What is known of the passing times of no hoops."""
ROUNDING_UNITS = 256
"""Rounding error of all terms but the sum over the samples, in units in the last place of their magnitudes."""


class ChainTerms:
    """The terms of all chains of one problem, grid, branch, and knowledge of the passing times.

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
        most = int(((self._windows[:, 1] - self._windows[:, 0]) // grid.stride).max(initial=0)) + 1
        self._pairs = np.ones((len(self._windows) - 1, max(most, 1), max(most, 1)), np.bool_)

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
            left=self._pairs,
        )
        if len(self.hoops) and len(self._programmes) == 2:
            chain = chain._replace(left=pairs_left(chain, self._limits, -self._shared(y, chain) - self._rounding(y)))
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
        push = self.problem.speed * unit(end)
        slope[self.vectors - 2 : self.vectors] = push
        heights = (chain.places[-1, 0, 1] - self._heights) / self._duration
        slope[self.vectors : -2] = self._signs * (self._bends[-1] * push[1] + heights)
        slope[-2:] = self._penalty_ends
        return slope

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


def unit(vector: Array) -> Array:
    """Return a vector divided by its length; zero for zero."""
    return np.asarray(vector / max(float(np.hypot(*vector)), LEAST_LENGTH))
