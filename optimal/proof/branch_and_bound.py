"""Branch and bound for one duration T: is every flight of duration T excluded?

The search starts with one branch of all flights, with the tilt on a circle. A branch for which no excluding stages are
found is branched into the windings, and then halved by the tilt, the hardest branch first, at the instant where this
helps most. The branches and multipliers of an excluded duration are the start for the next one.
"""

from __future__ import annotations

import heapq
import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import NamedTuple

from flatgym.quadrotor import Array
from optimal.proof.branches import Branch
from optimal.proof.bundle_method import MAX_EVALUATIONS
from optimal.proof.stages import EXPENSIVE, Exclusion, Stage
from optimal.proof.stations import Problem

TILT_SHARES = (0.25, 0.5, 0.75)
"""Instants at which the tilt may be halved, as shares of T."""
CIRCLE_EVALUATIONS, RELAXED_EVALUATIONS = 12, 6
"""Most evaluations of F for the branch of all flights, and with hoops ignored that hardly matter."""


class Candidate(NamedTuple):
    """A branch, and initial multipliers for it."""

    branch: Branch
    multipliers: Array


class ExcludedBranch(NamedTuple):
    """A branch, and the stages that exclude it."""

    branch: Branch
    stages: tuple[Stage, ...]


class BranchBound(NamedTuple):
    """A branch, the best multipliers found for it, and the value of F; a negative value excludes the branch."""

    candidate: Candidate
    value: float
    stages: tuple[Stage, ...]


def windings(problem: Problem) -> range:
    """Return the windings that can be flown within the duration of a problem."""
    reach = problem.scenario.quadrotor.rate_max * problem.duration + problem.slack
    most = math.floor(reach / (2 * math.pi)) + 1
    return range(-most, most + 1)


@dataclass
class BranchAndBound:
    """A search for branches that cover all flights, and stages that exclude each of them.

    Args:
        candidates: branches that cover all flights, with initial multipliers.
        active: the hoops that matter to the fastest known flight. The others are first ignored.
        deadline: when to stop, on the clock of `time.monotonic` [s].
    """

    candidates: Sequence[Candidate]
    active: tuple[int, ...]
    deadline: float
    evaluations: int = field(default=0, init=False)

    def exclude(self, problem: Problem, turn: int) -> list[ExcludedBranch] | None:
        """Return excluded branches that cover all flights; None if the deadline passed before.

        Args:
            problem: the flights to exclude.
            turn: least number of angles of a turn on the last grid.
        """
        excluded: list[BranchBound] = []
        queue: list[tuple[float, int, Candidate]] = []
        untried, number = list(self.candidates), count()

        def sort(bounds: Iterable[BranchBound]) -> None:
            for bound in bounds:
                if bound.value < 0:
                    excluded.append(bound)
                else:
                    heapq.heappush(queue, (-bound.value, next(number), bound.candidate))

        while untried or queue:
            if time.monotonic() > self.deadline:
                return None
            if untried:
                sort([self._bound(problem, turn, untried.pop())])
            else:
                sort(self._parts(problem, turn, heapq.heappop(queue)[2]))
        self.candidates = [bound.candidate for bound in excluded]
        return [ExcludedBranch(bound.candidate.branch, bound.stages) for bound in excluded]

    def _bound(self, problem: Problem, turn: int, candidate: Candidate) -> BranchBound:
        """Search for stages that exclude a branch, from the multipliers of the candidate."""
        branch, start = candidate
        search = Exclusion(problem, branch, start, turn, self.deadline)
        if branch.winding is None:
            search.limit = EXPENSIVE
        if self.active != problem.hoops:
            search.run(self.active, RELAXED_EVALUATIONS)
        if not search.done:
            search.multipliers = start
            search.run(problem.hoops, CIRCLE_EVALUATIONS if branch.winding is None else MAX_EVALUATIONS)
        self.evaluations += search.evaluations
        return BranchBound(Candidate(branch, search.multipliers), search.value, tuple(search.stages))

    def _parts(self, problem: Problem, turn: int, candidate: Candidate) -> list[BranchBound]:
        """Return the bounds of the parts of a branch."""
        branch, multipliers = candidate
        if branch.winding is None:
            parts = [Branch(winding) for winding in windings(problem)]
            return [self._bound(problem, turn, Candidate(part, multipliers)) for part in parts]
        best: list[BranchBound] = []
        for share in TILT_SHARES:
            halves = branch.halve_tilt(share, _reachable_tilts(problem, branch.winding, share))
            bounds = [self._bound(problem, turn, Candidate(half, multipliers)) for half in halves]
            if not best or _difficulty(bounds) < _difficulty(best):
                best = bounds
            if _difficulty(best) < (1, 0.0):
                break
        return best


def _reachable_tilts(problem: Problem, winding: int, share: float) -> tuple[float, float]:
    """Return the range of tilts that a flight of a winding can have at an instant, by the rate limit alone [rad]."""
    turned = problem.scenario.quadrotor.rate_max * problem.duration
    end, slack = 2 * math.pi * winding, problem.slack
    before, after = turned * share, turned * (1 - share)
    return max(-before, end - slack - after), min(before, end + slack + after)


def _difficulty(bounds: Sequence[BranchBound]) -> tuple[int, float]:
    """Return the number of branches that are not excluded, and the greatest F among them."""
    left = [bound.value for bound in bounds if bound.value >= 0]
    return len(left), max(left, default=0.0)
