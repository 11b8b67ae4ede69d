"""A proven lower bound of the flight time, with the data needed to check it again.

A time T is excluded if every flight of duration T belongs to an excluded branch (`optimal.proof.branch_and_bound`). All
shorter times are then excluded too, because a flight could hover first. The first T is well below the time of the
fastest known flight. The gap to that time is then halved repeatedly, so that any time budget ends with a proof. The
initial multipliers are the costates of the fastest known flight.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

from flatgym.quadrotor import Array
from flatgym.scenarios.catalogue import ScenarioLike, scenario
from flatgym.scenarios.scenario import Scenario, Tolerance
from optimal.direct.feasibility import beyond_horizon, infeasibility_proof, infeasibility_suspect
from optimal.direct.multistart import search
from optimal.direct.shooting import ShootingSolution
from optimal.flights.projection_bound import passing_windows, projection_bound
from optimal.proof.branch_and_bound import BranchAndBound, ExcludedBranch, windings
from optimal.proof.branches import Branch, covered
from optimal.proof.dual import Dual
from optimal.proof.initial_multipliers import kink_shares, multipliers
from optimal.proof.tilt_program import compile_kernels
from optimal.proof.time_grid import TimeGrid, angles_for, time_grid

MAX_GAP, TIME_BUDGET = 1e-3, 60.0
"""Requested relative gap between the bound and the fastest known flight, and wall time allowed for it [s]."""
LARGEST_GAP = 10.0
"""Upper limit of the first gap of a proof, where the projection bound gives none."""


class Verdict(StrEnum):
    """How a proof ended, a sentence with advice."""

    CLOSED = "Proven: no flight is faster, to within the requested gap."
    BUDGET_SPENT = "Proven with a larger gap than requested: the time budget was spent. Increase it for a smaller gap."
    ONE_STEP_SHORT = (
        "Proven, but one step short: a flight whose controls may change at any time arrives one step earlier, and this "
        "proof does not use that controls are held over a step."
    )
    NO_FLIGHT = (
        "Proven by the projection bound only: no flight is known to start from. `optimal.solve` reports why none was "
        "found."
    )
    IMPOSSIBLE = "Proven: no flight of this scenario exists, however slow."


@dataclass(frozen=True)
class Proof:
    """A proven lower bound with the data needed to check it.

    Attributes:
        scenario: the task.
        tolerance: goal tolerance; None requires exact rest at the goal.
        time: no flight takes less [s]; inf if no flight exists.
        flown: the time of the fastest known flight [s]; inf if none is known.
        verdict: how the proof ended, a sentence.
        reason: why no flight is known or none exists; else empty.
        grid: instants and angles of the dynamic programme; None if `time` is the projection bound.
        excluded: branches that cover all flights, and the multipliers that exclude them.
        kinks: times at which the slope of q may jump at floor and ceiling, as shares of T.
        evaluations: number of evaluations of F.
        wall_time: wall time of the proof [s].
    """

    scenario: Scenario
    tolerance: Tolerance | None
    time: float
    flown: float
    verdict: Verdict
    reason: str = ""
    grid: TimeGrid | None = None
    excluded: tuple[ExcludedBranch, ...] = ()
    kinks: tuple[float, ...] = ()
    evaluations: int = 0
    wall_time: float = 0.0

    @property
    def gap(self) -> float:
        """The relative gap flown / time - 1; inf if no flight is known."""
        return self.flown / self.time - 1 if math.isfinite(self.flown) and self.time > 0 else math.inf

    def check(self) -> bool:
        """Return whether the proof holds when recomputed: the branches cover all flights, and each is excluded.

        A proof without branches holds if `time` is at most the recomputed projection bound.
        """
        if self.grid is None:
            least = math.inf if infeasibility_proof(self.scenario) else projection_bound(self.scenario, self.tolerance)
            return self.time <= least
        if self.grid.rate_max != self.scenario.quadrotor.rate_max:
            return False
        windows = passing_windows(self.scenario, self.flown, self.tolerance)
        for winding in windings(self.scenario, self.tolerance, self.grid.time):
            branches = [branch for branch, _ in self.excluded if branch.winding == winding]
            if not covered(branches, windows):
                return False
        return self.time <= self.grid.time <= self.flown and all(self._excludes(*each) for each in self.excluded)

    def _excludes(self, branch: Branch, multipliers: Array) -> bool:
        """Return whether multipliers exclude a branch for the time of the grid."""
        assert self.grid is not None
        dual = Dual(self.scenario, self.grid, branch, self.tolerance, self.kinks)
        if (multipliers[dual.signed] < 0).any():
            return False
        return not dual.possible or max(cut.value + cut.rounding for cut in dual(multipliers)) < 0


def prove(
    problem: ScenarioLike,
    *,
    tolerance: Tolerance | None = None,
    max_gap: float = MAX_GAP,
    time_budget: float = TIME_BUDGET,
) -> Proof:
    """Prove a lower bound of the flight time of a scenario, close to the time of the fastest flight found.

    Args:
        problem: a scenario or its name.
        tolerance: goal tolerance; None requires exact rest at the goal.
        max_gap: requested relative gap between the bound and the fastest flight from rest to rest.
        time_budget: wall time after which the proof stops [s]. A proof that stops there depends on the machine.

    Raises:
        ValueError: for an unknown scenario, or a gap or budget that is not positive.
    """
    target = scenario(problem)
    require_positive(max_gap, time_budget)
    if reason := infeasibility_proof(target):
        return Proof(target, tolerance, math.inf, math.inf, Verdict.IMPOSSIBLE, reason)
    far = beyond_horizon(target)
    shots = () if far else search(target).shots
    if not shots:
        simple, reason = projection_bound(target, tolerance), far or infeasibility_suspect(target)
        return Proof(target, tolerance, simple, math.inf, Verdict.NO_FLIGHT, reason)
    return prove_near(target, shots[0], tolerance=tolerance, max_gap=max_gap, time_budget=time_budget)


def lower_bound(
    problem: ScenarioLike,
    *,
    tolerance: Tolerance | None = None,
    max_gap: float = MAX_GAP,
    time_budget: float = TIME_BUDGET,
) -> float:
    """Return a proven lower bound of the flight time of a scenario [s]; arguments as in `prove`."""
    return prove(problem, tolerance=tolerance, max_gap=max_gap, time_budget=time_budget).time


def prove_near(
    target: Scenario,
    shot: ShootingSolution,
    *,
    tolerance: Tolerance | None = None,
    max_gap: float = MAX_GAP,
    time_budget: float = TIME_BUDGET,
) -> Proof:
    """Prove a lower bound as `prove` does, from a given direct solution of the scenario and its costates."""
    require_positive(max_gap, time_budget)
    flown = shot.trajectory.duration
    simple = projection_bound(target, tolerance)
    gaps = [max_gap]
    while gaps[0] < LARGEST_GAP and flown / (1 + 2 * gaps[0]) > simple:
        gaps.insert(0, 2 * gaps[0])
    grids = [time_grid(flown / (1 + gap), target.quadrotor.rate_max, turn=angles_for(gap)) for gap in gaps]
    return raise_bound(target, shot, flown, tolerance, grids, time_budget)


def raise_bound(
    target: Scenario,
    shot: ShootingSolution,
    flown: float,
    tolerance: Tolerance | None,
    grids: Iterable[TimeGrid],
    budget: float,
) -> Proof:
    """Exclude the times of grids in increasing order, until one cannot be excluded within the budget.

    Args:
        target: the task.
        shot: its direct solution, for the initial multipliers.
        flown: the time of the fastest known flight [s].
        tolerance: goal tolerance; None requires exact rest at the goal.
        grids: the grids.
        budget: wall time [s].
    """
    compile_kernels()
    begun = time.monotonic()
    kinks = kink_shares(target, shot)
    start = multipliers(target, shot, kinks)
    windows = tuple(passing_windows(target, flown, tolerance))
    roots = [ExcludedBranch(Branch(winding, windows), start) for winding in windings(target, tolerance, flown)]
    search_tree = BranchAndBound(target, tolerance, kinks, roots, begun + budget)
    proof = Proof(target, tolerance, projection_bound(target, tolerance), flown, Verdict.CLOSED)
    for grid in grids:
        # The windows of the passing times are valid for flights that take no longer than `flown`.
        if grid.time > flown or not search_tree.exclude(grid):
            proof = replace(proof, verdict=Verdict.BUDGET_SPENT)
            break
        if grid.time > proof.time:
            proof = replace(proof, time=grid.time, grid=grid, excluded=tuple(search_tree.branches), kinks=kinks)
    return replace(proof, evaluations=search_tree.evaluations, wall_time=time.monotonic() - begun)


def require_positive(max_gap: float, time_budget: float) -> None:
    """Raise ValueError unless gap and time budget are positive."""
    for name, value in (("max_gap", max_gap), ("time_budget", time_budget)):
        if not value > 0:
            raise ValueError(f"{name} must be positive, got {value!r}")
