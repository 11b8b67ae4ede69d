"""The environment's optimum K*: the fewest steps of dt that end within the tolerance.

The search starts from the fastest flights from rest to rest, one of each local optimum. They are solved on the coarse
grid. With two or more hoops they are solved on the full grid, because local optima are many there, and differ by less
than the error of the coarse grid. Their costates (r, q, p) estimate what the tolerance saves, to first order

    T - T_tolerant = position |r| + speed |q(T)| + angle |p(T)|.

From there K decreases as long as a flight in K steps is found. If none is found at the first K, K increases until one
is (`optimal.discrete.fixed_steps`). A flight counts only after its float32 actions were replayed in the environment to
the outcome "goal". The dual bound then proves that fewer steps are impossible (`optimal.proof.lower_bound`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenarios.catalogue import ScenarioLike, scenario
from flatgym.scenarios.scenario import Scenario
from optimal.direct.feasibility import beyond_horizon, infeasibility_proof
from optimal.direct.multistart import coarse_multistart, distinct_optima, search
from optimal.direct.shooting import WINDINGS, ShootingSolution, solve_along, solve_tolerant
from optimal.direct.solver_process import SolverLost, lost_calls
from optimal.direct.transcription import distinct_hoops
from optimal.discrete.fixed_steps import StepSolution, remove_one_step, solve_in_steps
from optimal.flights.projection_bound import projection_bound
from optimal.flights.solution import SolveFailed, Status
from optimal.flights.trajectory import Trajectory

TIME_BUDGET = 5.0
"""Time limit of the proof that fewer steps are impossible [s]."""
OBSTACLES = 3
"""Most chains of an unfinished proof near which fewer steps are searched."""
EXTRA_STEPS = 8
"""Most K that are tried upwards, beginning with the first that seems possible."""
COARSE_GRID_ERROR = 0.02
"""Largest relative excess of a flight time on the coarse grid over one in environment steps."""
FULL_GRID_ERROR = 5e-4
"""The same for a flight to the tolerance on the full grid; on the named tracks at most 3e-4."""
LARGEST_SAVING = 0.08
"""Largest relative saving by the tolerance that costates estimate; it is 0.04 where they are right. They grow without
limit where a flight is rigid, as at a hoop beside the goal or for a vehicle that hardly turns."""
STARTS = 2
"""Starts for each winding; with three no random goal takes fewer steps."""


@dataclass(frozen=True)
class FewestSteps:
    """The answer of `fewest_steps`.

    Attributes:
        scenario: the task.
        steps: K, the number of environment steps to the goal; inf where no flight was found.
        actions: the environment's actions, float32, shape (K, 2).
        states: the states, from start to goal, shape (K+1, 5).
        winding: whole turns of the tilt.
        tolerance_used: share of the tolerance that the flight needs, the square root of m.
        lower_bound: fewer steps than this are impossible for any flight.
        status: how the search ended, a sentence.
        reason: without a flight, the known obstacle; without a proof of optimality, how the proof ended; in any case
            the number of the solver's calls that did not return; else empty.
    """

    scenario: Scenario
    steps: float
    actions: NDArray[np.float32]
    states: Array
    winding: int
    tolerance_used: float
    lower_bound: int
    status: Status
    reason: str = ""

    @property
    def proven(self) -> bool:
        """Whether no flight needs fewer steps: lower_bound = steps."""
        return self.lower_bound >= self.steps

    @property
    def trajectory(self) -> Trajectory | None:
        """The flight under the held controls of the actions; None if no flight was found."""
        if not len(self.actions):
            return None
        quadrotor = self.scenario.quadrotor
        time: Array = self.scenario.dt * np.arange(len(self.states), dtype=np.float64)
        return Trajectory(time, self.states, quadrotor.control(self.actions), quadrotor)

    @classmethod
    def failed(cls, target: Scenario, status: Status, reason: str = "", lower_bound: int = 0) -> Self:
        """Return the answer without a flight."""
        actions, states = np.zeros((0, 2), np.float32), np.zeros((0, 5))
        return cls(target, math.inf, actions, states, 0, math.inf, lower_bound, status, reason)


def fewest_steps(
    problem: ScenarioLike,
    *,
    windings: Sequence[int] = WINDINGS,
    time_budget: float = TIME_BUDGET,
    raise_on_failure: bool = True,
) -> FewestSteps:
    """Return the fewest environment steps in which a flight of the scenario is found.

    Args:
        problem: a scenario or its name.
        windings: whole turns to try.
        time_budget: time limit of the proof that fewer steps are impossible [s]; 0 leaves the projection bound. As
            for `solve`, it ends between two evaluations of the bound and does not limit the search for the flight.
        raise_on_failure: raise SolveFailed instead of returning a result without a flight.

    Raises:
        SolveFailed: with the problem and the result, when no flight was found.
        ValueError: for an unknown scenario, a negative budget, or no windings.
    """
    if not time_budget >= 0:
        raise ValueError(f"time_budget must be at least 0 s, got {time_budget!r}")
    target = scenario(problem)
    bound = math.ceil(projection_bound(target, target.tolerance) / target.dt - 1e-9)
    with lost_calls() as lost:
        try:
            result = _searched(target, windings, bound, time_budget)
        except SolverLost:
            result = FewestSteps.failed(target, Status.NOT_CONVERGED, lower_bound=bound)
    result = replace(result, reason=" ".join(filter(None, [result.reason, str(lost)])))
    if raise_on_failure and not len(result.actions):
        raise SolveFailed(target, result)
    return result


def _searched(target: Scenario, windings: Sequence[int], bound: int, time_budget: float) -> FewestSteps:
    """Return the answer for a task whose flights need at least `bound` steps."""
    infeasible = infeasibility_proof(target)
    obstacle, shots = infeasible or beyond_horizon(target), []
    if not obstacle:
        shots = starting_flights(distinct_hoops(target), windings)
    found = search_steps(target, shots, bound)
    if found is not None:
        steps, reason = len(found.actions), ""
        if bound < steps and time_budget > 0:
            found, bound, reason = _proven(target, shots[0], found, bound, time_budget)
            steps = len(found.actions)
        status = Status.PROVEN if bound == steps else Status.BEST_KNOWN
        return FewestSteps(target, steps, *found, bound, status, "" if bound == steps else reason)
    status = Status.INFEASIBLE if infeasible else Status.NO_STEPS_FOUND
    if bound > target.max_steps:
        status, obstacle = Status.INFEASIBLE, _time_limit_too_short(target, bound)
    elif shots:
        duration = tolerant_flight(distinct_hoops(target), shots[0]).duration
        obstacle = f"The fastest flight found takes about {duration:.4g} s of {target.time_limit:g} s."
    return FewestSteps.failed(target, status, obstacle, bound)


def _proven(
    target: Scenario, shot: ShootingSolution, found: StepSolution, bound: int, time_budget: float
) -> tuple[StepSolution, int, str]:
    """Return the flight, a proven lower bound of the number of steps, and how the proof ended.

    Where the proof stops at a chain that it cannot exclude, a flight in fewer steps is searched near that chain.
    """
    # Imported here, because it needs numba, which takes longer to import than everything else.
    from optimal.discrete.step_bound import least_steps, prove_steps

    proof = prove_steps(distinct_hoops(target, shared=False), shot, len(found.actions), time_budget)
    bound = max(bound, least_steps(proof))
    for passing, tilts in proof.obstacles[:OBSTACLES] if bound < len(found.actions) else ():
        near = solve_along(distinct_hoops(target), proof.flown * passing, tilts)
        found = (search_steps(target, [near], bound, found) if near.converged else None) or found
    return found, bound, proof.verdict.value


def starting_flights(target: Scenario, windings: Sequence[int]) -> list[ShootingSolution]:
    """Return flights from rest to rest, one of each local optimum, the fastest first."""
    if len(target.hoops) > 1:
        return list(search(target, windings=windings, starts=STARTS).shots)
    tried = coarse_multistart(target, windings, starts=STARTS, slack=COARSE_GRID_ERROR)
    return [alike[0] for alike in distinct_optima(tried)]


def _time_limit_too_short(target: Scenario, bound: int) -> str:
    return (
        f"Any flight needs at least {bound} steps of {target.dt} s, and time_limit = {target.time_limit} s allows "
        f"{target.max_steps}; raise it."
    )


def expected_duration(target: Scenario, shot: ShootingSolution) -> float:
    """Return the estimated duration of a flight like `shot` that may end anywhere within the tolerance [s]."""
    costate, tolerance = shot.costates[-1], target.tolerance
    shares = [np.hypot(*costate[0:2]), np.hypot(*costate[2:4]), abs(costate[4])]
    return shot.trajectory.duration - float(np.dot(shares, [tolerance.position, tolerance.speed, tolerance.angle]))


def search_steps(
    target: Scenario, shots: Sequence[ShootingSolution], bound: int, best: StepSolution | None = None
) -> StepSolution | None:
    """Return the flight in the fewest steps that is found near free-time ones; None if none is found.

    Args:
        target: the task.
        shots: flights from rest to rest, the fastest first.
        bound: fewer steps than this are impossible.
        best: a known flight, which is returned if none in fewer steps is found.
    """
    flown = distinct_hoops(target)
    for shot in shots:
        best = _fewer_steps(target, tolerant_flight(flown, shot), shot.winding, bound, best)
    if best is None:
        for shot in shots:
            rest = TolerantFlight(shot.trajectory, shot.trajectory.duration, 1.0)
            best = _fewer_steps(target, rest, shot.winding, bound, best)
    return best


def _fewer_steps(
    target: Scenario, near: TolerantFlight, winding: int, bound: int, best: StepSolution | None
) -> StepSolution | None:
    """Return the flight in the fewest steps found near one of a winding; `best` if there is none in fewer steps."""
    flight, duration, error = near
    least = max(bound, math.ceil(duration * (1 - error) / target.dt))
    first = max(bound, math.ceil(duration / target.dt))
    count = min(first, target.max_steps if best is None else len(best.actions) - 1)
    if count < least:
        return best
    found = solve_in_steps(target, flight, winding, count)
    while found is None and best is None and count < min(first + EXTRA_STEPS, target.max_steps):
        count += 1
        found = solve_in_steps(target, flight, winding, count)
    while found is not None:
        best = found
        found = one_step_less(target, flight, best) if len(best.actions) > least else None
    return best


class TolerantFlight(NamedTuple):
    """A free-time flight, and the time in which one like it reaches the tolerance.

    Attributes:
        flight: the flight.
        duration: the time to the tolerance [s].
        error: largest relative excess of that time over one in environment steps.
    """

    flight: Trajectory
    duration: float
    error: float


def tolerant_flight(target: Scenario, shot: ShootingSolution) -> TolerantFlight:
    """Return a flight near one from rest to rest, with the time in which one like it reaches the tolerance.

    With two or more hoops, or where the costates do not tell that time, the flight ends within the tolerance itself.
    """
    full_grid, rest = len(target.hoops) > 1, shot.trajectory.duration
    duration = expected_duration(target, shot)
    estimated = duration >= rest * (1 - LARGEST_SAVING)
    if full_grid or not estimated:
        tolerant = solve_tolerant(target, shot)
        if tolerant.converged:
            error = FULL_GRID_ERROR if full_grid else COARSE_GRID_ERROR
            return TolerantFlight(tolerant.trajectory, tolerant.trajectory.duration, error)
    if not estimated:
        return TolerantFlight(shot.trajectory, rest, 1.0)
    return TolerantFlight(shot.trajectory, duration, COARSE_GRID_ERROR)


def one_step_less(target: Scenario, flight: Trajectory, best: StepSolution) -> StepSolution | None:
    """Return a flight of at least one step less than the best; None if none is found.

    With hoops, further attempts start from the best flight itself. Without hoops they are left out, because all starts
    led to the same m.

    Args:
        target: the task.
        flight: a free-time flight of the same winding.
        best: the flight in the fewest steps so far.
    """
    found = solve_in_steps(target, flight, best.winding, len(best.actions) - 1)
    if found is not None or not target.hoops:
        return found
    return remove_one_step(target, best)
