"""Branch and bound for one time T: is every flight of duration T excluded?

The roots of the search are the windings. A branch for which no excluding multipliers are found is halved, the hardest
branch first. It is halved by the passing time of a hoop while the width of that interval is the obstacle: while the
interval is wide, or while its midpoint alone can be excluded. Otherwise it is halved by the tilt, at the instant where
this helps most. The branches and multipliers of an excluded time are the start for the next time.
"""

from __future__ import annotations

import heapq
import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import NamedTuple

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario, Tolerance
from optimal.proof.branches import Branch, Interval
from optimal.proof.bundle_method import MAX_EVALUATIONS, separate
from optimal.proof.dual import Dual, hoop_kinks
from optimal.proof.rounding import LEAST_LENGTH
from optimal.proof.time_grid import TimeGrid

TILT_SHARES = (0.25, 0.5, 0.75)
"""Instants at which the tilt may be halved, as shares of T."""
MIDPOINT_EVALUATIONS = 24
"""Most evaluations of F to decide whether the midpoints of the passing intervals can be excluded."""
KINK_FLOOR = 0.3
"""Least weight of a hoop's kink in the choice of the interval to halve, as a share of the greatest kink. An interval
costs its kink times its width, but the kink of a wide interval may be small because it is costly."""
WIDE_INTERVAL = 1 / 32
"""Passing intervals wider than this share of T are halved without a trial."""


class ExcludedBranch(NamedTuple):
    """A branch, and multipliers that exclude it."""

    branch: Branch
    multipliers: Array


class BranchBound(NamedTuple):
    """A branch, the best multipliers found for it, and the value of F; a negative value excludes the branch."""

    candidate: ExcludedBranch
    value: float


def windings(scenario: Scenario, tolerance: Tolerance | None, duration: float) -> range:
    """Return the windings that can be flown within a duration [s]."""
    slack = tolerance.angle if tolerance else 0.0
    most = math.floor((scenario.quadrotor.rate_max * duration + slack) / (2 * math.pi)) + 1
    return range(-most, most + 1)


@dataclass
class BranchAndBound:
    """A search for branches that cover all flights, and multipliers that exclude each of them.

    Args:
        scenario: the task.
        tolerance: goal tolerance; None requires exact rest at the goal.
        kinks: times at which the slope of q may jump at floor and ceiling, as shares of T.
        branches: branches that cover all flights, and initial multipliers. After `exclude` returned True they are the
            excluded branches with their multipliers.
        deadline: when to stop, on the clock of `time.monotonic` [s].
    """

    scenario: Scenario
    tolerance: Tolerance | None
    kinks: Sequence[float]
    branches: Sequence[ExcludedBranch]
    deadline: float
    evaluations: int = field(default=0, init=False)

    def exclude(self, grid: TimeGrid) -> bool:
        """Return whether all branches were excluded for the time of a grid before the deadline."""
        excluded: list[ExcludedBranch] = []
        queue: list[tuple[float, int, ExcludedBranch]] = []
        untried, number = list(self.branches), count()

        def sort(bounds: Iterable[BranchBound]) -> None:
            for candidate, value in bounds:
                if value < 0:
                    excluded.append(candidate)
                else:
                    heapq.heappush(queue, (-value, next(number), candidate))

        while untried or queue:
            if time.monotonic() > self.deadline:
                self.branches = [*excluded, *untried, *(candidate for _, _, candidate in queue)]
                return False
            if untried:
                sort([self._bound(grid, untried.pop())])
            else:
                sort(self._halves(grid, heapq.heappop(queue)[2]))
        self.branches = excluded
        return True

    def _bound(self, grid: TimeGrid, candidate: ExcludedBranch, max_evaluations: int = MAX_EVALUATIONS) -> BranchBound:
        """Search for multipliers that exclude a branch, from those of the candidate."""
        branch, start = candidate
        dual = Dual(self.scenario, grid, branch, self.tolerance, self.kinks)
        if not dual.possible:
            return BranchBound(candidate, -math.inf)
        separation = separate(dual, start, max_evaluations)
        self.evaluations += separation.evaluations
        return BranchBound(ExcludedBranch(branch, separation.multipliers), separation.value)

    def _halves(self, grid: TimeGrid, candidate: ExcludedBranch) -> list[BranchBound]:
        """Return the bounds of the two halves of a branch."""
        branch, multipliers = candidate
        hoop = self._hoop_to_halve(grid, candidate)
        if hoop is not None:
            return [self._bound(grid, ExcludedBranch(half, multipliers)) for half in branch.halve_passing(hoop)]
        best: list[BranchBound] = []
        for share in TILT_SHARES:
            halves = branch.halve_tilt(share, self._reachable_tilts(grid, branch, share))
            bounds = [self._bound(grid, ExcludedBranch(half, multipliers)) for half in halves]
            if not best or _difficulty(bounds) < _difficulty(best):
                best = bounds
            if _difficulty(best) < (1, 0.0):
                break
        return best

    def _hoop_to_halve(self, grid: TimeGrid, candidate: ExcludedBranch) -> int | None:
        """Return the hoop whose passing interval should be halved; None if that would not help."""
        branch, start = candidate
        if not branch.passing:
            return None
        widths = np.array([high - low for low, high in branch.passing])
        kinks = np.hypot(*hoop_kinks(start, len(widths)).T)
        costliest = int(np.argmax(widths * (kinks + KINK_FLOOR * kinks.max() + LEAST_LENGTH)))
        if widths[costliest] > WIDE_INTERVAL:
            return costliest
        if widths[costliest] * grid.steps <= 1:
            return None
        midpoints = tuple(((low + high) / 2,) * 2 for low, high in branch.passing)
        alone = ExcludedBranch(replace(branch, passing=midpoints), start)
        return costliest if self._bound(grid, alone, MIDPOINT_EVALUATIONS).value < 0 else None

    def _reachable_tilts(self, grid: TimeGrid, branch: Branch, share: float) -> Interval:
        """Return the range of tilts that a flight of a branch can have at an instant, by the rate limit alone [rad]."""
        before, after = (grid.rate_max * grid.time * part for part in (share, 1 - share))
        slack, end = self.tolerance.angle if self.tolerance else 0.0, 2 * math.pi * branch.winding
        return max(-before, end - slack - after), min(before, end + slack + after)


def _difficulty(bounds: Sequence[BranchBound]) -> tuple[int, float]:
    """Return the number of branches that are not excluded, and the greatest F among them."""
    left = [value for _, value in bounds if value >= 0]
    return len(left), max(left, default=0.0)
