"""Stages: the exclusion of one branch for one duration, with windows of the passing times from coarse grids to fine.

Each stage is one grid, the hoops of its chain, and multipliers. It cuts from the windows the time steps in which no
flight passes a hoop. The last stage leaves no flight. The windows follow from the stages, so a proof stores the stages
only.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Hoop, Scenario
from optimal.proof.branches import Branch
from optimal.proof.bundle_method import MAX_EVALUATIONS, separate
from optimal.proof.dual import Dual
from optimal.proof.stations import Problem, Windows, hoops_apart, possible_windows
from optimal.proof.time_grid import TimeGrid, time_grid

COARSE_EVALUATIONS = 12
"""Most evaluations of F on a grid that is not the last."""
SHRINKAGE = 0.7
"""The windows are cut again with the same multipliers while their total length falls below this share."""
LEAST_ANGLES = 40
"""Fewest angles of a turn of a coarse grid."""
CHEAP, EXPENSIVE = 3e6, 6e9
"""A cost of one evaluation at which no coarser grid is tried before, and one at which all flights are branched into
windings instead, in samples times tilts."""


class Stage(NamedTuple):
    """One step of an exclusion.

    Attributes:
        grid: instants and angles of the dynamic programme.
        hoops: the hoops of the chain, ascending. The others are ignored.
        multipliers: the multipliers of `optimal.proof.dual.Dual`.
    """

    grid: TimeGrid
    hoops: tuple[int, ...]
    multipliers: Array


def excluded(problem: Problem, branch: Branch, stages: Sequence[Stage]) -> bool:
    """Return whether stages exclude all flights of a branch. Everything is recomputed from the problem."""
    windows = possible_windows(problem)
    for stage in stages:
        if not _admissible(problem, stage):
            return False
        dual = Dual(problem, stage.grid, branch, stage.hoops, [windows[i] for i in stage.hoops])
        y = stage.multipliers
        if not dual.apart or y.shape != (dual.size,) or not np.isfinite(y).all() or (y[dual.signed] < 0).any():
            return False
        if not dual.possible:
            return True
        left = dual.prune(y)
        if left is None:
            return True
        windows = _cut(windows, stage.hoops, left)
    return False


def _admissible(problem: Problem, stage: Stage) -> bool:
    """Return whether grid and hoops of a stage belong to a problem."""
    grid, hoops = stage.grid, stage.hoops
    ascending = all(a < b for a, b in pairwise(hoops)) and set(hoops) <= {*problem.hoops}
    return ascending and grid.rate_max == problem.scenario.quadrotor.rate_max and grid.time >= problem.duration


def _cut(windows: Windows, hoops: Sequence[int], left: Sequence[tuple[float, float]]) -> Windows:
    """Return the intersections of the windows of all hoops with what is left of some."""
    found = list(windows)
    for hoop, (low, high) in zip(hoops, left, strict=True):
        found[hoop] = (max(found[hoop][0], low), min(found[hoop][1], high))
    return tuple(found)


@dataclass
class Exclusion:
    """A search for stages that exclude a branch.

    Attributes after `run`:
        stages: the stages found; they exclude the branch if `done`.
        multipliers: the last multipliers for all hoops.
        value: the last value of F; negative if `done`.
        evaluations: number of evaluations of F.

    Args:
        problem: the flights.
        branch: the class of flights.
        multipliers: initial multipliers for all hoops.
        turn: least number of angles of a turn on the last grid.
        deadline: when to stop, on the clock of `time.monotonic` [s].
        limit: greatest cost of one evaluation, in samples times tilts.
    """

    problem: Problem
    branch: Branch
    multipliers: Array
    turn: int
    deadline: float
    limit: float = np.inf
    stages: list[Stage] = field(default_factory=list)
    value: float = np.inf
    evaluations: int = 0

    @property
    def done(self) -> bool:
        """Whether the stages exclude the branch."""
        return self.value < 0

    def run(self, hoops: Sequence[int], max_evaluations: int = MAX_EVALUATIONS) -> Exclusion:
        """Search with a chain through some hoops, on grids from coarse to fine."""
        self.windows: Windows = possible_windows(self.problem)
        self.stages, self.value = [], np.inf
        rate = self.problem.scenario.quadrotor.rate_max
        grids = [time_grid(self.problem.duration, rate, turn=self.turn)]
        while hoops and self._cost(grids[0], hoops) > CHEAP and grids[0].turn >= 2 * LEAST_ANGLES:
            coarser = time_grid(self.problem.duration, rate, turn=grids[0].turn * 2 // 3)
            if coarser.turn >= grids[0].turn:
                break
            grids.insert(0, coarser)
        for grid in grids:
            last = grid is grids[-1]
            if time.monotonic() > self.deadline or self._cost(grid, hoops) > self.limit:
                break
            if self._stage(grid, hoops, max_evaluations if last else COARSE_EVALUATIONS, last):
                break
            if self.branch.winding is None and len(hoops) > 1 and math.isfinite(self.value):
                break  # The windings are then cheaper than a finer grid for all of them.
        return self

    def _stage(self, grid: TimeGrid, hoops: Sequence[int], max_evaluations: int, last: bool) -> bool:
        """Cut the windows on one grid, and search for multipliers that exclude the branch there."""
        hoops = hoops_apart(self.problem, grid, hoops) if hoops else ()
        dual = self._dual(grid, hoops)
        y = self._select(hoops)
        if not dual.possible:
            return self._add(grid, hoops, y, -np.inf)
        if hoops and self._prune(grid, hoops, y):
            return True
        if grid.turn < self.turn / 2.5:
            return False  # The multipliers of a coarse grid suit its errors, not the next grid.
        found = separate(self._dual(grid, hoops), y, max_evaluations, self.deadline)
        self.evaluations += found.evaluations
        self._insert(hoops, found.multipliers)
        if found.value < 0:
            return self._add(grid, hoops, found.multipliers, found.value)
        self.value = found.value
        return bool(hoops) and not last and self._prune(grid, hoops, found.multipliers)

    def _prune(self, grid: TimeGrid, hoops: tuple[int, ...], y: Array) -> bool:
        """Cut the windows with some multipliers while they shrink. Return whether no flight is left."""
        while True:
            dual = self._dual(grid, hoops)
            left = dual.prune(y) if dual.possible else None
            self.evaluations += 1
            if left is None:
                return self._add(grid, hoops, y, -np.inf)
            before = self._length(hoops)
            windows = _cut(self.windows, hoops, left)
            if windows == self.windows:
                return False
            self.windows = windows
            self.stages.append(Stage(grid, hoops, y))
            if self._length(hoops) > SHRINKAGE * before or time.monotonic() > self.deadline:
                return False

    def _add(self, grid: TimeGrid, hoops: tuple[int, ...], y: Array, value: float) -> bool:
        self.stages.append(Stage(grid, hoops, y))
        self.value = value
        return True

    def _dual(self, grid: TimeGrid, hoops: tuple[int, ...]) -> Dual:
        return Dual(self.problem, grid, self.branch, hoops, [self.windows[i] for i in hoops])

    def _length(self, hoops: Sequence[int]) -> float:
        return sum(self.windows[i][1] - self.windows[i][0] for i in hoops)

    def _cost(self, grid: TimeGrid, hoops: Sequence[int]) -> float:
        """Return the cost of one evaluation, in samples times tilts."""
        counts = [1.0, *(1 + (self.windows[i][1] - self.windows[i][0]) / grid.dt for i in hoops), 1.0]
        pairs = sum(a * b for a, b in pairwise(counts))
        return 2 * pairs * grid.steps / len(counts[1:]) * grid.turn

    def _positions(self, hoops: Sequence[int]) -> Array:
        """Return the indices of the multipliers of a chain through some hoops among those of all hoops."""
        stations = [0, *(i + 1 for i in hoops), len(self.problem.hoops) + 1]
        vectors = [2 * i + component for i in stations for component in (0, 1)]
        rest = np.arange(2 * (len(self.problem.hoops) + 2), len(self.multipliers))
        return np.concatenate([vectors, rest]).astype(np.int64)

    def _select(self, hoops: Sequence[int]) -> Array:
        y = self.multipliers[self._positions(hoops)]
        return np.asarray(y / max(float(np.linalg.norm(y)), np.finfo(np.float64).tiny))

    def _insert(self, hoops: Sequence[int], y: Array) -> None:
        positions = self._positions(hoops)
        scale = float(np.linalg.norm(self.multipliers[positions]))
        self.multipliers = self.multipliers.copy()
        self.multipliers[positions] = scale * y


@lru_cache(maxsize=1)
def compile_kernels() -> None:
    """Compile the kernels or load them from disk, before a time budget starts. The first compilation takes seconds."""
    scenario = Scenario("kernels", (0.0, 0.0), (4.0, 0.0), (Hoop(2.0, 0.0, 1.0),))
    for winding in (None, 0):
        problem = Problem(scenario, None, 1.0)
        grid = time_grid(problem.duration, scenario.quadrotor.rate_max, turn=LEAST_ANGLES)
        dual = Dual(problem, grid, Branch(winding), (0,), [(0.5, 0.6)])
        dual(np.ones(dual.size))
        dual.prune(np.ones(dual.size))
