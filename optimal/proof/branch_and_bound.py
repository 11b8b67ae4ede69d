"""Branch and bound for one duration T: is every flight of duration T excluded?

The search starts with one branch of all flights, with the tilt on a circle. A branch for which no excluding stages are
found is branched into the windings, and then split by a tilt or a passing time, the hardest branch first. If no
multipliers have F < 0, a combination of chains has the subgradient zero. The branch is split by the quantity on which
these chains disagree most, at their mean. The branches and multipliers of an excluded duration are the start for the
next one.
"""

from __future__ import annotations

import heapq
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import NamedTuple

import numpy as np

from flatgym.quadrotor import Array
from optimal.proof.branches import Branch
from optimal.proof.bundle_method import MAX_EVALUATIONS
from optimal.proof.stages import EXPENSIVE, Exclusion, Stage
from optimal.proof.stations import Problem

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
    """A branch, the best multipliers found for it, and the value of F; a negative value excludes the branch.

    `parts` are the branches into which it is best split otherwise.
    """

    candidate: Candidate
    value: float
    stages: tuple[Stage, ...] = ()
    parts: tuple[Branch, ...] = ()


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
        queue: list[tuple[float, int, BranchBound]] = []
        untried, number = list(self.candidates), count()
        known = {candidate.branch.winding for candidate in untried}
        if None not in known:  # More windings can be flown in a longer time.
            new = [winding for winding in windings(problem) if winding not in known]
            untried += [Candidate(Branch(winding), untried[0].multipliers) for winding in new]

        def sort(bound: BranchBound) -> None:
            if bound.value < 0:
                excluded.append(bound)
            else:
                heapq.heappush(queue, (-bound.value, next(number), bound))

        while untried or queue:
            if time.monotonic() > self.deadline:
                return None
            if not untried:
                bound = heapq.heappop(queue)[2]
                untried = [Candidate(part, bound.candidate.multipliers) for part in bound.parts]
            sort(self._bound(problem, turn, untried.pop()))
        self.candidates = [bound.candidate for bound in excluded]
        return [ExcludedBranch(bound.candidate.branch, bound.stages) for bound in excluded]

    def _bound(self, problem: Problem, turn: int, candidate: Candidate) -> BranchBound:
        """Search for stages that exclude a branch, from the multipliers of the candidate."""
        branch, start = candidate
        every = tuple(Branch(winding) for winding in windings(problem)) if branch.winding is None else ()
        if every and len(problem.hoops) > 1:  # One programme for all windings mixes them, and leaves a gap open.
            return BranchBound(candidate, np.inf, parts=every)
        search = Exclusion(problem, branch, start, turn, self.deadline)
        if every:
            search.limit = EXPENSIVE
        if self.active != problem.hoops:
            search.run(self.active, RELAXED_EVALUATIONS)
        if not search.done:
            search.multipliers = start
            search.run(problem.hoops, CIRCLE_EVALUATIONS if every else MAX_EVALUATIONS)
        self.evaluations += search.evaluations
        parts = every if every or search.done else tuple(search.split())
        return BranchBound(Candidate(branch, search.multipliers), search.value, tuple(search.stages), parts)
