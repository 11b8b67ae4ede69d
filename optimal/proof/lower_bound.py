"""A proven lower bound of the flight time, with the data needed to check it again.

A time T is excluded if every flight of duration T belongs to an excluded branch (`optimal.proof.branch_and_bound`). All
shorter times are then excluded too, because a flight could hover first. The first T is well below the time of the
fastest known flight. The gap to that time is then divided by a constant repeatedly, so that any time budget ends with a
proof. A T that cannot be excluded in most of the time left gives way to one between it and the bound. The initial
multipliers are the costates of the fastest known flight.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from pathlib import Path

from flatgym.scenarios.catalogue import ScenarioLike, scenario
from flatgym.scenarios.scenario import Scenario, Tolerance
from optimal.direct.feasibility import beyond_horizon, infeasibility_proof, infeasibility_suspect
from optimal.direct.multistart import AGREEMENT, search
from optimal.direct.shooting import ShootingSolution, solve_along
from optimal.flights.projection_bound import projection_bound
from optimal.proof import files
from optimal.proof.branch_and_bound import BranchAndBound, ExcludedBranch, windings
from optimal.proof.branches import Branch, covered
from optimal.proof.exclusion import Obstacle, compile_kernels
from optimal.proof.initial_multipliers import active_hoops, kink_shares, multipliers
from optimal.proof.programme.rounding import UNIT_ROUNDOFF
from optimal.proof.programme.stations import Passing, Problem
from optimal.proof.programme.time_grid import angles_for
from optimal.proof.stages import Stage, passing_left

MAX_GAP, TIME_BUDGET = 1e-3, 60.0
"""Requested relative gap between the bound and the fastest known flight, and wall time allowed for it [s]."""
LARGEST_GAP = 10.0
"""Upper limit of the first gap of a proof, where the projection bound gives none."""
GAP_STEP, TRACK_GAP_STEP = 8.0, 4.0
"""Ratio of consecutive gaps, and the same with several hoops, where an attempt that fails costs more."""
SHARE, LEAST_GAP_STEP = 2 / 3, 1.5
"""Share of the time left in which a duration must be excluded, before one between it and the bound is tried, and least
ratio of their gaps for that."""

OBSTACLES = 3
"""Most obstacles near which a faster flight is searched."""
HOLD_GAP = 4e-3
"""Gap that sets the angles of the grids on which windows are cut before the grids for held controls."""


class Verdict(StrEnum):
    """How a proof ended, a sentence with advice."""

    CLOSED = "Proven: no flight is faster, to within the requested gap."
    BUDGET_SPENT = "Proven with a larger gap than requested: the time budget was spent. Increase it for a smaller gap."
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
        common: stages that cut the passing times of all flights.
        excluded: branches that cover all flights, and the stages that exclude them after the common ones; none if
            `time` is the projection bound.
        kinks: times at which the slope of q may jump at floor and ceiling, as shares of T.
        steps: number of environment steps in `time`, if the proof uses that controls are held over steps; else 0.
        evaluations: number of evaluations of F.
        wall_time: wall time of the proof [s].
        obstacles: chains of a greater time that the budget did not suffice to exclude, the hardest first. A faster
            flight may be near one of them. They are not saved.
    """

    scenario: Scenario
    tolerance: Tolerance | None
    time: float
    flown: float
    verdict: Verdict
    reason: str = ""
    common: tuple[Stage, ...] = ()
    excluded: tuple[ExcludedBranch, ...] = ()
    kinks: tuple[float, ...] = ()
    steps: int = 0
    evaluations: int = 0
    wall_time: float = 0.0
    obstacles: tuple[Obstacle, ...] = field(default=(), compare=False, repr=False)

    @property
    def gap(self) -> float:
        """The relative gap flown / time - 1; inf if no flight is known."""
        return self.flown / self.time - 1 if math.isfinite(self.flown) and self.time > 0 else math.inf

    def check(self) -> bool:
        """Return whether the proof holds when recomputed: the branches cover all flights, and each is excluded.

        A proof without branches holds if `time` is at most the recomputed projection bound.
        """
        if not self.excluded:
            least = math.inf if infeasibility_proof(self.scenario) else projection_bound(self.scenario, self.tolerance)
            return self.time <= least
        if not 0 < self.time < math.inf:
            return False
        if self.steps and self.time != self.steps * self.scenario.dt:
            return False
        problem = Problem(self.scenario, self.tolerance, self.time, self.kinks, self.steps)
        if not covered((branch for branch, _ in self.excluded), windings(problem)):
            return False
        try:
            passing = passing_left(problem, Branch(), self.common, Passing.possible(problem))
            return passing is None or all(passing_left(problem, *each, passing) is None for each in self.excluded)
        except ValueError:
            return False

    def save(self, path: str | Path) -> Path:
        """Write the proof as JSON with exact numbers, and return the path of its file."""
        saved = [each.name for each in fields(self) if each.compare]
        return files.write(path, {name: getattr(self, name) for name in saved})

    @classmethod
    def load(cls, path: str | Path) -> Proof:
        """Return the proof of a file. It is not checked.

        Raises:
            ValueError: for a file that is not a proof.
        """
        values = files.decode(Path(path).read_text(encoding="utf-8"))
        try:
            return cls(**values | {"verdict": Verdict[values["verdict"]]})
        except (KeyError, TypeError) as error:
            raise ValueError(f"not a proof: {error}") from None


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
    begun = time.monotonic()
    proof = prove_near(target, shots[0], tolerance=tolerance, max_gap=max_gap, time_budget=time_budget)
    faster = faster_flight(target, proof)
    if faster is None:
        return proof
    left = max(time_budget - (time.monotonic() - begun), time_budget / 2)
    again = prove_near(target, faster, tolerance=tolerance, max_gap=max_gap, time_budget=left)
    return again if again.time >= proof.time else replace(proof, flown=again.flown)


def faster_flight(target: Scenario, proof: Proof) -> ShootingSolution | None:
    """Return the fastest flight near the obstacles of a proof that is faster than the fastest known; None without."""
    found = []
    for passing, tilts in proof.obstacles[:OBSTACLES]:
        shot = solve_along(target, proof.flown * passing, tilts)
        if shot.converged and shot.trajectory.duration < proof.flown * (1 - AGREEMENT):
            found.append(shot)
    return min(found, key=lambda shot: shot.trajectory.duration, default=None)


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
    gaps, ratio = [max_gap], gap_step(target)
    while gaps[0] < LARGEST_GAP and flown / (1 + ratio * gaps[0]) > simple:
        gaps.insert(0, ratio * gaps[0])
    # A quotient of rounded numbers must not exceed the requested gap.
    durations = [(flown / (1 + gap) * (1 + 4 * UNIT_ROUNDOFF), gap) for gap in gaps]
    return raise_bound(target, shot, tolerance, durations, time_budget)


def gap_step(target: Scenario) -> float:
    """Return the ratio of consecutive gaps of a proof."""
    return TRACK_GAP_STEP if len(target.hoops) > 1 else GAP_STEP


def raise_bound(
    target: Scenario,
    shot: ShootingSolution,
    tolerance: Tolerance | None,
    durations: Iterable[tuple[float, float]],
    budget: float,
    *,
    flown: float | None = None,
    steps: int = 0,
) -> Proof:
    """Exclude durations in increasing order, and durations below the first that takes too long, within the budget.

    Args:
        target: the task.
        shot: its direct solution, for the initial multipliers.
        tolerance: goal tolerance; None requires exact rest at the goal.
        durations: the durations [s], each with the relative gap that sets the angles of its grid.
        budget: wall time [s].
        flown: the time of the fastest known flight [s]; by default that of the direct solution.
        steps: a number of environment steps that is excluded last, for controls that are held over steps; 0 for none.
    """
    compile_kernels()
    begun = time.monotonic()
    kinks = kink_shares(target, shot)
    search_tree = BranchAndBound(multipliers(target, shot, kinks), active_hoops(shot), begun + budget)
    simple, flown = projection_bound(target, tolerance), shot.trajectory.duration if flown is None else flown
    proof = Proof(target, tolerance, simple, flown, Verdict.CLOSED, kinks=kinks)
    pending = [(Problem(target, tolerance, time, kinks), angles_for(gap)) for time, gap in durations]
    if steps:
        pending.append((Problem(target, tolerance, steps * target.dt, kinks, steps), angles_for(HOLD_GAP)))
    least_open = 0.0
    while pending:
        problem, turn = pending.pop(0)
        now, gap = time.monotonic(), flown / problem.duration - 1
        last = problem.steps > 0 or not _wide(proof, gap)
        search_tree.deadline = now + (1.0 if last else SHARE) * (begun + budget - now)
        found = search_tree.exclude(problem, turn)
        if found is None:
            proof = replace(proof, verdict=Verdict.BUDGET_SPENT, obstacles=proof.obstacles or search_tree.obstacles)
            pending, least_open = [], 0.0 if last else gap
        elif problem.duration > proof.time:
            proof = replace(proof, time=problem.duration, steps=problem.steps, **found._asdict())
        if _wide(proof, least_open) and time.monotonic() < begun + budget:
            gap = math.sqrt(min(proof.gap, LARGEST_GAP) * least_open)
            pending = [(Problem(target, tolerance, flown / (1 + gap), kinks), angles_for(gap))]
    return replace(proof, evaluations=search_tree.evaluations, wall_time=time.monotonic() - begun)


def _wide(proof: Proof, gap: float) -> bool:
    """Return whether a gap that was not reached leaves room for one between it and the gap of a proof."""
    return 0 < gap < proof.gap / LEAST_GAP_STEP


def require_positive(max_gap: float, time_budget: float) -> None:
    """Raise ValueError unless gap and time budget are positive."""
    for name, value in (("max_gap", max_gap), ("time_budget", time_budget)):
        if not value > 0:
            raise ValueError(f"{name} must be positive, got {value!r}")
