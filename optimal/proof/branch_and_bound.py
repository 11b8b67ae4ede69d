"""Branch and bound for one duration T: is every flight of duration T excluded?

The search starts with one branch of all flights, with the tilt on a circle. If it is not excluded, its stages still cut
the passing times of all flights. It is then branched into the windings. A branch for which no excluding stages are
found is split by a tilt or a passing time, the hardest branch first, and its parts keep its stages. If no multipliers
have F < 0, a combination of chains has the subgradient zero. The branch is split by the quantity on which these chains
disagree most, at their mean. The branches and multipliers of an excluded duration are the start for the next one.
"""

from __future__ import annotations

import heapq
import math
import time
from dataclasses import dataclass, field
from itertools import count
from typing import NamedTuple

from flatgym.quadrotor import Array
from optimal.proof.branches import Branch
from optimal.proof.bundle_method import MAX_EVALUATIONS
from optimal.proof.exclusion import Exclusion, Obstacle
from optimal.proof.programme.stations import Passing, Problem
from optimal.proof.stages import Stage, within

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
    """What was found for a branch.

    Attributes:
        candidate: the branch and the best multipliers found.
        value: F there; a negative value excludes the branch.
        stages: the stages found.
        passing: what they leave of the passing times.
        parts: the branches into which it is best split; none if there was no time for an evaluation.
        obstacle: the chain that stands in the way of excluding it.
    """

    candidate: Candidate
    value: float
    stages: tuple[Stage, ...]
    passing: Passing
    parts: tuple[Branch, ...]
    obstacle: Obstacle | None


class Exclusions(NamedTuple):
    """Proof that no flight takes a time.

    Attributes:
        common: stages that cut the passing times of all flights.
        excluded: branches that cover all flights, and the stages that exclude each of them after the common ones.
    """

    common: tuple[Stage, ...]
    excluded: tuple[ExcludedBranch, ...]


def windings(problem: Problem) -> range:
    """Return the windings that can be flown within the duration of a problem."""
    reach = problem.scenario.quadrotor.rate_max * problem.duration + problem.slack
    most = math.floor(reach / (2 * math.pi)) + 1
    return range(-most, most + 1)


@dataclass
class BranchAndBound:
    """A search for branches that cover all flights, and stages that exclude each of them.

    Args:
        multipliers: initial multipliers.
        active: the hoops that matter to the fastest known flight. The others are first ignored.
        deadline: when to stop, on the clock of `time.monotonic` [s]. It may be set anew for each duration.

    Attributes:
        obstacles: after a deadline, the chains of the branches that are not excluded, the hardest branch first.
    """

    multipliers: Array
    active: tuple[int, ...]
    deadline: float
    evaluations: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.obstacles: tuple[Obstacle, ...] = ()
        self._known: dict[int, list[Candidate]] = {}

    def exclude(self, problem: Problem, turn: int) -> Exclusions | None:
        """Return branches that cover all flights, with the stages that exclude them; None if the deadline passed.

        Args:
            problem: the flights to exclude.
            turn: least number of angles of a turn on the last grid.
        """
        everything = Candidate(Branch(), self.multipliers)
        root = self._bound(problem, turn, everything, Passing.possible(problem))
        if root.value < 0:
            return Exclusions((), (ExcludedBranch(Branch(), root.stages),))
        excluded: list[BranchBound] = []
        queue: list[tuple[float, int, BranchBound]] = []
        untried, number = list[tuple[Candidate, BranchBound]](), count()
        common = root._replace(stages=())
        for winding in windings(problem):
            known = self._known.get(winding, [Candidate(Branch(winding), root.candidate.multipliers)])
            untried += [(candidate, common) for candidate in known]
        while untried or queue:
            hopeless = not untried and not queue[0][2].parts
            if hopeless or time.monotonic() > self.deadline:
                self.obstacles = tuple(bound.obstacle for *_, bound in sorted(queue) if bound.obstacle)
                return None
            if not untried:
                parent = heapq.heappop(queue)[2]
                untried = [(Candidate(part, parent.candidate.multipliers), parent) for part in parent.parts]
            candidate, parent = untried.pop()
            bound = self._bound(problem, turn, candidate, parent.passing, parent.stages)
            if bound.value < 0:
                excluded.append(bound)
            else:
                heapq.heappush(queue, (-bound.value, next(number), bound))
        self._known = {}
        for bound in excluded:
            self._known.setdefault(bound.candidate.branch.winding or 0, []).append(bound.candidate)
        return Exclusions(root.stages, tuple(ExcludedBranch(each.candidate.branch, each.stages) for each in excluded))

    def _bound(
        self, problem: Problem, turn: int, candidate: Candidate, passing: Passing, stages: tuple[Stage, ...] = ()
    ) -> BranchBound:
        """Search for stages that exclude a branch, from the multipliers of the candidate."""
        branch, start = candidate
        search = Exclusion(problem, branch, start, turn, self.deadline, within(problem, branch, passing), stages)
        circle = branch.winding is None
        if self.active != problem.hoops:
            search.run(self.active, RELAXED_EVALUATIONS)
        if not search.done:
            search.multipliers = start
            search.run(problem.hoops, CIRCLE_EVALUATIONS if circle else MAX_EVALUATIONS)
        self.evaluations += search.evaluations
        parts = () if circle or search.done else tuple(search.split())
        found, obstacle = Candidate(branch, search.multipliers), None if search.done else search.obstacle()
        return BranchBound(found, search.value, search.stages, search.passing, parts, obstacle)
