"""The proof that nothing is faster: a lower bound of the flight time, with all that is needed to check it.

T is impossible when every flight that takes T belongs to a branch that is shown to be impossible
(`optimal.proof.branch_and_bound`); so are all shorter times, because a flight could hover first. T begins well below the fastest
flight known and comes closer by halves of the gap, or one environment step after the other, so that whatever time
is granted ends in a proof of something. Multipliers start as the costates of the fastest flight found.
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
from flatgym.task.transition import CONTACT_SLACK
from optimal.direct.feasibility import beyond_horizon, impossible, suspect
from optimal.direct.multistart import search
from optimal.direct.shooting import ShootingSolution, solve_winding
from optimal.flights.projection_bound import passing_windows, projection_bound
from optimal.proof.branch_and_bound import Exclusion, Shown, windings
from optimal.proof.branches import Branch, covered
from optimal.proof.dual import Dual
from optimal.proof.initial_multipliers import kink_shares, multipliers
from optimal.proof.tilt_program import TimeGrid, angles_for, ready, time_grid

MAX_GAP, TIME_BUDGET = 1e-3, 60.0
"""How close to the fastest flight known a bound is to come, relatively, and the time granted for it [s]."""
LOOSEST = 10.0
"""A gap from which no proof begins, where the simple bound is no help."""
ROOM = 1e-9
"""By how much a task is widened to be sure that an environment's rounding is inside [m, m/s, rad]."""


class Verdict(StrEnum):
    """How a proof ended, as a sentence that says what to do about it."""

    CLOSED = "Proven: no flight is faster, to within the gap asked for."
    BUDGET_SPENT = "Proven, but less close than asked for: the time budget was spent; grant more."
    FREE = (
        "Proven, but one step short: a flight whose controls may change at any time arrives a step earlier, which "
        "this proof cannot tell from one of held controls."
    )
    NO_FLIGHT = (
        "Proven by thrust alone: no flight is known to begin from, so only the simple bound was computed; "
        "`optimal.solve` says why none was found."
    )
    IMPOSSIBLE = "Proven: no flight of this scenario exists, however slow."


@dataclass(frozen=True)
class Proof:
    """A lower bound with all that is needed to check it.

    Attributes:
        scenario: the task.
        tolerance: what counts as arrived; None is exactly at rest at the goal.
        time: no flight takes less [s]; inf where there is none at all.
        flown: the time of the fastest flight known [s]; inf where none is.
        verdict: how the proof ended, a sentence.
        reason: where nothing close to a flight could be proven, why; else empty.
        grid: the instants of the dual programme; None where `time` is the bound of thrust alone.
        shown: branches that cover all flights, and their multipliers.
        kinks: where the weights may bend at floor and ceiling, as shares of T.
        evaluations: how often F was computed.
        wall_time: what it took [s].
    """

    scenario: Scenario
    tolerance: Tolerance | None
    time: float
    flown: float
    verdict: Verdict
    reason: str = ""
    grid: TimeGrid | None = None
    shown: tuple[Shown, ...] = ()
    kinks: tuple[float, ...] = ()
    evaluations: int = 0
    wall_time: float = 0.0

    @property
    def gap(self) -> float:
        """flown / time - 1; inf where nothing was flown."""
        return self.flown / self.time - 1 if math.isfinite(self.flown) and self.time > 0 else math.inf

    def check(self) -> bool:
        """Compute the proof again: do the branches leave no flight out, and is each impossible by its multipliers?

        Without branches the bound is that of thrust alone, and computed again.
        """
        if self.grid is None:
            least = math.inf if impossible(self.scenario) else projection_bound(self.scenario, self.tolerance)
            return self.time <= least
        if self.grid.rate_max != self.scenario.quadrotor.rate_max:
            return False
        windows = passing_windows(self.scenario, self.flown, self.tolerance)
        for winding in windings(self.scenario, self.tolerance, self.grid.time):
            branches = [shown.branch for shown in self.shown if shown.branch.winding == winding]
            if not covered(branches, windows):
                return False
        return self.time <= self.grid.time <= self.flown and all(self._excluded(*shown) for shown in self.shown)

    def _excluded(self, branch: Branch, multipliers: Array) -> bool:
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
    """Prove that no flight of a scenario is faster than a time close to that of the fastest found.

    Args:
        problem: a scenario or its name.
        tolerance: what counts as arrived; None is exactly at rest at the goal.
        max_gap: how close to the fastest flight from rest to rest the bound is to come, relatively.
        time_budget: when to stop trying [s]; where it is spent, the bound depends on it.

    Raises:
        ValueError: for an unknown scenario, or a gap or budget that is not positive.
    """
    target = scenario(problem)
    _check(max_gap, time_budget)
    if reason := impossible(target):
        return Proof(target, tolerance, math.inf, math.inf, Verdict.IMPOSSIBLE, reason)
    far = beyond_horizon(target)
    shots = () if far else search(target).shots
    if not shots:
        simple, reason = projection_bound(target, tolerance), far or suspect(target)
        return Proof(target, tolerance, simple, math.inf, Verdict.NO_FLIGHT, reason)
    return prove_near(target, shots[0], tolerance=tolerance, max_gap=max_gap, time_budget=time_budget)


def lower_bound(
    problem: ScenarioLike,
    *,
    tolerance: Tolerance | None = None,
    max_gap: float = MAX_GAP,
    time_budget: float = TIME_BUDGET,
) -> float:
    """Return a time [s] that no flight of a scenario can beat; see `prove`, which also says how it is known."""
    return prove(problem, tolerance=tolerance, max_gap=max_gap, time_budget=time_budget).time


def prove_near(
    target: Scenario,
    shot: ShootingSolution,
    *,
    tolerance: Tolerance | None = None,
    max_gap: float = MAX_GAP,
    time_budget: float = TIME_BUDGET,
) -> Proof:
    """Do what `prove` does, from the fastest flight of a scenario and its costates."""
    _check(max_gap, time_budget)
    flown = shot.trajectory.duration
    simple = projection_bound(target, tolerance)
    gaps = [max_gap]
    while gaps[0] < LOOSEST and flown / (1 + 2 * gaps[0]) > simple:
        gaps.insert(0, 2 * gaps[0])
    grids = [time_grid(flown / (1 + gap), target.quadrotor.rate_max, turn=angles_for(gap)) for gap in gaps]
    return _raise_bound(target, shot, flown, tolerance, grids, time_budget)


def prove_steps(target: Scenario, shot: ShootingSolution, steps: int, time_budget: float = TIME_BUDGET) -> Proof:
    """Prove that no flight reaches the goal of an environment in fewer steps than known, or nearly so.

    That controls are held over a step is left out: no flight whatever arrives within the tolerance earlier. Gaps,
    heights and tolerance are widened by ROOM, so that the environment's rounding is inside.
    """
    _check(MAX_GAP, time_budget)
    wide, fewer = widened(target), (steps - 1) * target.dt
    free = solve_winding(wide, shot.winding, tolerant=True)
    known = free.converged and free.trajectory.duration <= fewer * (1 + ROOM)
    last = free.trajectory.duration / (1 + MAX_GAP) if known else fewer
    simple, less, times = projection_bound(wide, wide.tolerance), 2, [last]
    while (steps - less) * target.dt > simple:
        if (steps - less) * target.dt < last:
            times.insert(0, (steps - less) * target.dt)
        less *= 2
    turns = [angles_for(steps * target.dt / value - 1) for value in times[:-1]] + [angles_for(MAX_GAP)]
    rate = target.quadrotor.rate_max
    grids = [time_grid(value * (1 + ROOM), rate, turn=turn) for value, turn in zip(times, turns, strict=True)]
    proof = _raise_bound(wide, shot, steps * target.dt, wide.tolerance, grids, time_budget)
    return replace(proof, verdict=Verdict.FREE) if known and proof.verdict is Verdict.CLOSED else proof


def least_steps(proof: Proof) -> int:
    """Return the fewest environment steps that a proof leaves possible."""
    # The quotient may have been rounded across a whole number, the product is compared as the environment's time is.
    shown = round(proof.time / proof.scenario.dt)
    return shown + 1 if shown * proof.scenario.dt <= proof.time else shown


def widened(target: Scenario) -> Scenario:
    """Return a scenario with gaps, heights and tolerance wider by ROOM, heights also by what the environment allows."""
    near, depth = target.tolerance, CONTACT_SLACK + ROOM
    return replace(
        target.with_diameters(hoop.diameter + 2 * ROOM for hoop in target.hoops),
        floor=None if target.floor is None else target.floor - depth,
        ceiling=None if target.ceiling is None else target.ceiling + depth,
        tolerance=Tolerance(near.position + ROOM, near.speed + ROOM, near.angle + ROOM),
    )


def _raise_bound(
    target: Scenario,
    shot: ShootingSolution,
    flown: float,
    tolerance: Tolerance | None,
    grids: Iterable[TimeGrid],
    budget: float,
) -> Proof:
    """Exclude the times of grids, the shortest first, until one cannot be excluded within the budget."""
    ready()
    begun = time.monotonic()
    kinks = kink_shares(target, shot)
    start = multipliers(target, shot, kinks)
    windows = tuple(passing_windows(target, flown, tolerance))
    roots = [Shown(Branch(winding, windows), start) for winding in windings(target, tolerance, flown)]
    exclusion = Exclusion(target, tolerance, kinks, roots, begun + budget)
    proof = Proof(target, tolerance, projection_bound(target, tolerance), flown, Verdict.CLOSED)
    for grid in grids:
        # The windows in which hoops are passed hold for flights that take no longer than `flown`.
        if grid.time > flown or not exclusion.exclude(grid):
            proof = replace(proof, verdict=Verdict.BUDGET_SPENT)
            break
        if grid.time > proof.time:
            proof = replace(proof, time=grid.time, grid=grid, shown=tuple(exclusion.shown), kinks=kinks)
    return replace(proof, evaluations=exclusion.evaluations, wall_time=time.monotonic() - begun)


def _check(max_gap: float, time_budget: float) -> None:
    for name, value in (("max_gap", max_gap), ("time_budget", time_budget)):
        if not value > 0:
            raise ValueError(f"{name} must be positive, got {value!r}")
