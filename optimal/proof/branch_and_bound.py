"""Branch and bound at one time T: is every flight that takes T impossible?

Flights are sorted by their turns; a branch for which no multipliers are found is halved: the interval in which a
hoop is passed while that is what is in the way - while it is wide, or the middle of it alone could be excluded -
else the tilt, at the instant where halving helps most. The hardest branch comes first. What was shown stays for the
next T.
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
from optimal.proof.bundle_method import STEPS, separate
from optimal.proof.dual import Dual, hoop_kinks
from optimal.proof.tilt_program import TINY, TimeGrid

HELD_SHARES = (0.25, 0.5, 0.75)
"""Instants at which the tilt may be halved, as shares of T."""
TRIAL_STEPS = 24
"""Steps granted to the question whether one passing time could be excluded alone."""
FAINT = 0.3
"""What the kink at a hoop counts for at least, as a share of the greatest: an interval costs its kink times its width,
but where it is wide the kink may be small because it costs so much."""
WIDE = 1 / 32
"""Intervals of passing times wider than this are halved without asking."""


class Shown(NamedTuple):
    """A branch, and multipliers that show it to be impossible."""

    branch: Branch
    multipliers: Array


class BranchBound(NamedTuple):
    """A branch, the best multipliers found for it, and F with them; less than 0 proves the branch impossible."""

    shown: Shown
    value: float


def windings(scenario: Scenario, tolerance: Tolerance | None, duration: float) -> range:
    """Return the numbers of turns that can be made within a duration [s]."""
    slack = tolerance.angle if tolerance else 0.0
    most = math.floor((scenario.quadrotor.rate_max * duration + slack) / (2 * math.pi)) + 1
    return range(-most, most + 1)


@dataclass
class Exclusion:
    """A growing proof: branches that cover all flights, and multipliers for each.

    Args:
        scenario: the task.
        tolerance: what counts as arrived; None is exactly at rest at the goal.
        kinks: where q may bend at floor and ceiling, as shares of T.
        shown: branches to begin with, and multipliers to begin from.
        deadline: when to stop, as time.monotonic tells it [s].
    """

    scenario: Scenario
    tolerance: Tolerance | None
    kinks: Sequence[float]
    shown: Sequence[Shown]
    deadline: float
    evaluations: int = field(default=0, init=False)

    def exclude(self, grid: TimeGrid) -> bool:
        """Return whether each branch was shown to be impossible for the grid's time before the deadline."""
        done: list[Shown] = []
        open_: list[tuple[float, int, Shown]] = []
        left, number = list(self.shown), count()

        def sort(tried: Iterable[BranchBound]) -> None:
            for shown, value in tried:
                if value < 0:
                    done.append(shown)
                else:
                    heapq.heappush(open_, (-value, next(number), shown))

        while left or open_:
            if time.monotonic() > self.deadline:
                self.shown = [*done, *left, *(shown for _, _, shown in open_)]
                return False
            if left:
                sort([self._try(grid, left.pop())])
            else:
                sort(self._halves(grid, heapq.heappop(open_)[2]))
        self.shown = done
        return True

    def _try(self, grid: TimeGrid, shown: Shown, steps: int = STEPS) -> BranchBound:
        branch, start = shown
        dual = Dual(self.scenario, grid, branch, self.tolerance, self.kinks)
        if not dual.possible:
            return BranchBound(shown, -math.inf)
        found = separate(dual, start, steps)
        self.evaluations += found.evaluations
        return BranchBound(Shown(branch, found.multipliers), found.value)

    def _halves(self, grid: TimeGrid, shown: Shown) -> list[BranchBound]:
        """Return the halves of a branch, tried."""
        hoop = self._hoop_in_the_way(grid, shown)
        if hoop is not None:
            return [self._try(grid, Shown(half, shown.multipliers)) for half in shown.branch.halve_passing(hoop)]
        best: list[BranchBound] = []
        for share in HELD_SHARES:
            halves = shown.branch.halve_tilt(share, self._reach(grid, shown.branch, share))
            tried = [self._try(grid, Shown(half, shown.multipliers)) for half in halves]
            if not best or _difficulty(tried) < _difficulty(best):
                best = tried
            if _difficulty(best) < (1, 0.0):
                break
        return best

    def _hoop_in_the_way(self, grid: TimeGrid, shown: Shown) -> int | None:
        """Return the hoop whose passing time is to be known better; None if that would not help."""
        branch, start = shown
        if not branch.passing:
            return None
        widths = np.array([high - low for low, high in branch.passing])
        kinks = np.hypot(*hoop_kinks(start, len(widths)).T)
        loosest = int(np.argmax(widths * (kinks + FAINT * kinks.max() + TINY)))
        if widths[loosest] > WIDE:
            return loosest
        if widths[loosest] * grid.steps <= 1:
            return None
        middles = tuple(((low + high) / 2,) * 2 for low, high in branch.passing)
        alone = self._try(grid, Shown(replace(branch, passing=middles), start), TRIAL_STEPS)
        return loosest if alone.value < 0 else None

    def _reach(self, grid: TimeGrid, branch: Branch, share: float) -> Interval:
        """Return the tilts a flight of a branch can have at an instant, by its rate alone [rad]."""
        before, after = (grid.rate_max * grid.time * part for part in (share, 1 - share))
        slack, end = self.tolerance.angle if self.tolerance else 0.0, 2 * math.pi * branch.winding
        return max(-before, end - slack - after), min(before, end + slack + after)


def _difficulty(tried: Sequence[BranchBound]) -> tuple[int, float]:
    """Return how many branches are left to show, and the greatest F among them."""
    left = [value for _, value in tried if value >= 0]
    return len(left), max(left, default=0.0)
