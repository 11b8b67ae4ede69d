"""The search for stages that exclude one branch, on grids from coarse to fine.

Each grid first cuts the passing times with the best multipliers known, then searches for better ones. A search ends
where finer grids do not help, and then names the quantity by which the branch is best split.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Hoop, Scenario
from optimal.proof.branches import Branch
from optimal.proof.bundle_method import MAX_EVALUATIONS, Separation, separate
from optimal.proof.dual import TILT_SHARES, Dual
from optimal.proof.programme.stations import STEPS_APART, Passing, Problem, hoops_apart, least_times
from optimal.proof.programme.tilt_program import Grid
from optimal.proof.programme.time_grid import HoldGrid, TimeGrid, hold_grid, time_grid
from optimal.proof.stages import Stage

WIDE_EVALUATIONS, CUT_EVALUATIONS = 4, 16
"""Most evaluations of F on a grid that is not the last: where they are expensive and the windows are not yet cut to
half their length, and otherwise."""
SHRINKAGE = 0.7
"""The windows are cut again with the same multipliers while their total length falls below this share."""
LEAST_ANGLES = 36
"""Fewest angles of a turn of a coarse grid."""
STALL = 0.7
"""A branch is split if F on a finer grid is more than this share of that on the grid before."""
HOLD_GRIDS = ((15, 2), (29, 4), (58, 8))
"""For held controls: least angles by which a step turns the vehicle, and instants in a step, from coarse to fine."""
STRIDES = (2, 1)
"""Most time steps in a cell of a chain through several hoops: on coarse grids, and on the last one."""
CHEAP, MODERATE = 1e7, 1e8
"""Costs of one evaluation in samples times tilts: at which no coarser grid is tried before, and from which on few
evaluations are made while the windows are wide."""
PACE = 3e-10
"""Time of an evaluation divided by its cost, until one was timed [s]."""


class Obstacle(NamedTuple):
    """A chain that stands in the way of excluding a branch: a flight near it may be faster than the fastest known.

    Attributes:
        passing: times at which hoops and goal are reached, as shares of T, shape (H+1,).
        tilts: tilts at equal distances in time from start to goal [rad].
    """

    passing: Array
    tilts: Array


@dataclass
class Exclusion:
    """A search for stages that exclude a branch.

    Attributes after `run`:
        stages, passing: with the stages found, and what they leave; they exclude the branch if `done`.
        multipliers: the last multipliers for all hoops.
        value: the last value of F; negative if `done`.
        evaluations: number of evaluations of F.

    Args:
        problem: the flights.
        branch: the class of flights.
        multipliers: initial multipliers for all hoops.
        turn: least number of angles of a turn on the last grid.
        deadline: when to stop, on the clock of `time.monotonic` [s].
        passing: what is known of the passing times of the flights of the branch.
        stages: stages that hold for the branch and led to this knowledge; the search adds to them.
    """

    problem: Problem
    branch: Branch
    multipliers: Array
    turn: int
    deadline: float
    passing: Passing
    stages: tuple[Stage, ...] = ()
    value: float = np.inf
    evaluations: int = 0

    @property
    def done(self) -> bool:
        """Whether the stages exclude the branch."""
        return self.value < 0

    def run(self, hoops: Sequence[int], max_evaluations: int = MAX_EVALUATIONS) -> Exclusion:
        """Search with a chain through some hoops, on grids from coarse to fine."""
        self._widest = self._length(hoops)
        self.value, self._starts, self._pace = np.inf, [self.multipliers], PACE
        self._separation: Separation | None = None
        stalled, before = {TimeGrid: 0, HoldGrid: 0}, np.inf
        kinds = self._grids(hoops)
        for make in kinds:
            grid = make()
            # Finer grids do not help where the chains of a grid disagree; a split does.
            kind = type(grid)
            if stalled[kind] >= (1 if self.problem.steps and kind is TimeGrid else 2):
                continue
            late = time.monotonic() + self._pace * self._cost(grid, hoops) > self.deadline
            if late:
                break
            if self._stage(grid, hoops, max_evaluations, make is kinds[-1]):
                break
            impossible = self._separation is not None and self._separation.impossible
            stalled[kind] += impossible + 2 * (self.value > STALL * before)
            before = self.value
        return self

    def obstacle(self) -> Obstacle | None:
        """Return the chain that stands in the way on the last grid; None without one through all hoops in order."""
        winding, found = self.branch.winding, self._separation
        if winding is None or found is None or self._chain_hoops != self.problem.hoops:
            return None
        passing = np.append(found.chain[: len(self._chain_hoops)], 1.0)
        tilts = np.concatenate([[0.0], found.chain[len(self._chain_hoops) :], [2 * np.pi * winding]])
        return Obstacle(passing, tilts) if (np.diff(passing, prepend=0.0) > 0).all() else None

    def split(self) -> list[Branch]:
        """Return two parts of the branch, split by the quantity on which the chains of the last grid disagree most.

        There are none if the deadline passed before the first evaluation.
        """
        branch, vehicle = self.branch, self.problem.scenario.quadrotor
        if self._separation is None:
            return []
        hoops = self._chain_hoops
        middle, spread = self._separation.middle, self._separation.spread.copy()
        spread[: len(hoops)] *= self.problem.duration * vehicle.rate_max  # as angles
        for i in np.argsort(-spread):
            if i < len(hoops):
                parts = branch.split_passing(hoops[i], float(middle[i]))
                proper = all(low < high for part in parts for hoop, low, high in part.passing)
            else:
                parts = branch.split_tilt(TILT_SHARES[i - len(hoops)], float(middle[i]))
                proper = all(low < high for part in parts for _, low, high in part.held)
            if proper:
                break
        return parts

    def _grids(self, hoops: Sequence[int]) -> list[Callable[[], Grid]]:
        """Return the grids from coarse to fine, each made when what is known of the passing times can set its cells.

        Held controls take grids of their own after those that cut windows.
        """
        problem, vehicle = self.problem, self.problem.scenario.quadrotor
        turns = [self.turn]
        while (
            hoops and turns[0] * 2 // 3 >= LEAST_ANGLES and self._cost(self._time_grid(turns[0], hoops), hoops) > CHEAP
        ):
            turns.insert(0, turns[0] * 2 // 3)
        makers: list[Callable[[], Grid]] = [partial(self._time_grid, turn, hoops) for turn in turns]
        if problem.steps and self.branch.winding is not None and len(hoops) == len(problem.hoops):
            for reach, parts in HOLD_GRIDS:
                size = {"reach": reach, "parts": parts if hoops else 1}
                makers.append(partial(hold_grid, problem.steps, problem.scenario.dt, vehicle.rate_max, **size))
        return makers

    def _time_grid(self, turn: int, hoops: Sequence[int]) -> TimeGrid:
        """Return a grid whose cells are as large as the distances of the hoops and the errors permit."""
        rate, cell = self.problem.scenario.quadrotor.rate_max, 0.0
        if len(hoops) > 1:
            step = 2 * np.pi / turn / rate
            least = least_times(self.problem, hoops, self.passing.of(hoops)).min()
            cell = np.clip(np.floor(least / STEPS_APART / step), 1, STRIDES[turn == self.turn]) * step
        return time_grid(self.problem.duration, rate, turn=turn, cell=float(cell))

    def _stage(self, grid: Grid, hoops: Sequence[int], max_evaluations: int, last: bool) -> bool:
        """Cut the windows on one grid, and search for multipliers that exclude the branch there."""
        hoops = hoops_apart(self.problem, grid, hoops, self.passing) if hoops else ()
        dual = self._dual(grid, hoops)
        starts = [self._select(hoops, start) for start in self._starts]
        if not dual.possible:
            return self._add(grid, hoops, starts[0], -np.inf)
        if hoops:
            if len(starts) > 1:
                starts.sort(key=lambda y: dual.evaluate(y).value)
                self.evaluations += len(starts)
            if self._prune(dual, starts[0]):
                return True
            dual = self._dual(grid, hoops)
        begun = time.monotonic()
        if not last and hoops:
            cut = self._length(hoops) < self._widest / 2 or self._cost(grid, hoops) < MODERATE
            max_evaluations = min(max_evaluations, CUT_EVALUATIONS if cut else WIDE_EVALUATIONS)
        found = separate(dual, starts, max_evaluations, self.deadline)
        self._pace = (time.monotonic() - begun) / found.evaluations / self._cost(grid, hoops)
        self.evaluations += found.evaluations
        self._separation, self._chain_hoops = found, dual.hoops
        self._insert(hoops, found.multipliers)
        if found.value < 0:
            return self._add(grid, hoops, found.multipliers, found.value)
        self.value = found.value
        return bool(hoops) and not last and self._prune(dual, found.multipliers)

    def _prune(self, dual: Dual, y: Array) -> bool:
        """Cut the windows with some multipliers while they shrink. Return whether no flight is left."""
        grid, hoops = dual.grid, dual.hoops
        while True:
            left = dual.prune(y) if dual.possible else None
            self.evaluations += 1
            if left is None:
                return self._add(grid, hoops, y, -np.inf)
            before = self._length(hoops)
            passing = self.passing.cut(hoops, left)
            if passing == self.passing:
                return False
            self.passing = passing
            self.stages = (*self.stages, Stage(grid, hoops, y))
            if self._length(hoops) > SHRINKAGE * before or time.monotonic() > self.deadline:
                return False
            dual = self._dual(grid, hoops)

    def _add(self, grid: Grid, hoops: tuple[int, ...], y: Array, value: float) -> bool:
        self.stages = (*self.stages, Stage(grid, hoops, y))
        self.value = value
        return True

    def _dual(self, grid: Grid, hoops: tuple[int, ...]) -> Dual:
        return Dual(self.problem, grid, self.branch, hoops, self.passing.of(hoops))

    def _length(self, hoops: Sequence[int]) -> float:
        return sum(high - low for low, high in self.passing.of(hoops).windows)

    def _cost(self, grid: Grid, hoops: Sequence[int]) -> float:
        """Return the cost of one evaluation, in samples times tilts."""
        known = self.passing.of(hoops)
        counts = [1.0, *(max(high - low, 0.0) / grid.cell + 1 for low, high in known.windows), 1.0]
        spans = [np.inf, *((high - low) / grid.cell + 4 for low, high in known.durations), np.inf]
        pairs = sum(a * min(b, span) for (a, b), span in zip(pairwise(counts), spans, strict=False))
        each = grid.reach / grid.parts if isinstance(grid, HoldGrid) else 2.0
        return each * pairs * grid.steps / len(counts[1:]) * grid.turn

    def _positions(self, hoops: Sequence[int]) -> Array:
        """Return the indices of the multipliers of a chain through some hoops among those of all hoops."""
        stations = [0, *(i + 1 for i in hoops), len(self.problem.hoops) + 1]
        vectors = [2 * i + component for i in stations for component in (0, 1)]
        rest = np.arange(2 * (len(self.problem.hoops) + 2), len(self.multipliers))
        return np.concatenate([vectors, rest]).astype(np.int64)

    def _select(self, hoops: Sequence[int], multipliers: Array) -> Array:
        y = multipliers[self._positions(hoops)]
        return np.asarray(y / max(float(np.linalg.norm(y)), np.finfo(np.float64).tiny))

    def _insert(self, hoops: Sequence[int], y: Array) -> None:
        """Take multipliers as the first start of the next grid, beside the initial ones."""
        positions = self._positions(hoops)
        scale = float(np.linalg.norm(self.multipliers[positions]))
        self.multipliers = self.multipliers.copy()
        self.multipliers[positions] = scale * y
        self._starts = [self.multipliers, self._starts[-1]]


@lru_cache(maxsize=1)
def compile_kernels() -> None:
    """Compile the kernels or load them from disk, before a time budget starts. The first compilation takes seconds."""
    scenario = Scenario("kernels", (0.0, 0.0), (4.0, 0.0), (Hoop(2.0, 0.0, 1.0),))
    for winding in (None, 0):
        problem = Problem(scenario, None, 1.0)
        grid = time_grid(problem.duration, scenario.quadrotor.rate_max, turn=LEAST_ANGLES)
        dual = Dual(problem, grid, Branch(winding), (0,), Passing(((0.5, 0.6),), ()))
        dual(np.ones(dual.size))
        dual.prune(np.ones(dual.size))
