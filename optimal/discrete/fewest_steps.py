"""The environment's own optimum K*: the fewest steps of dt that end within the tolerance.

The fastest flights from rest to rest on the coarse grid, one of each kind, say about how many steps
it takes: their costates (r, q, p) tell what the tolerance saves, to first order

    T - T_tolerant = position |r| + speed |q(T)| + angle |p(T)|.

From there K goes down as long as a flight in K steps is found, else up until one is
(`optimal.discrete.program`). What is found counts only after its float32 actions have been flown in the
environment to the outcome "goal".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenarios.catalogue import ScenarioLike, scenario
from flatgym.scenarios.scenario import Scenario
from flatgym.task.rollout import replay_to_goal
from optimal.direct import transcription as tr
from optimal.direct.feasibility import beyond_horizon, impossible
from optimal.direct.multistart import coarse_multistart, distinct_optima
from optimal.direct.shooting import WINDINGS, ShootingSolution
from optimal.discrete import program
from optimal.flights.projection_bound import projection_bound
from optimal.flights.replay import crossing_times
from optimal.flights.solution import SolveFailed, Status
from optimal.flights.trajectory import Trajectory

TIME_BUDGET = 5.0
"""Time granted for the proof that fewer steps are impossible [s]."""
ARRIVAL_MARGIN = 1e-3
"""How far below 1 the smallest tolerance m must be: float32 actions move the end by less."""
EXTRA_STEPS = 8
"""How many K are tried upwards, beginning with the first that seems possible."""
COARSE = 0.02
"""How much slower, relatively, a flight on the coarse grid may be than one in environment steps."""
STARTS = 2
"""Starts for each winding; with three no random goal takes fewer steps."""
ROUNDS = 6
"""How often the steps that cross the hoops are moved."""


@dataclass(frozen=True)
class FewestSteps:
    """The answer of `fewest_steps`.

    Attributes:
        scenario: what was flown.
        steps: K, the number of environment steps to the goal; inf where no flight was found.
        actions: the environment's actions, float32, shape (K, 2).
        states: the states flown, from start to goal, shape (K+1, 5).
        winding: whole turns of the tilt.
        tolerance_used: share of the tolerance the flight needs (the square root of m).
        lower_bound: fewer steps than this are impossible for any flight.
        proven: whether lower_bound = steps.
        status: how the search ended, a sentence.
        reason: where there is no flight, what stands in its way, as far as known; where one is not proven to take the
            fewest steps, how the proof ended; else empty.
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
        """Whether no flight whatever needs fewer steps."""
        return self.lower_bound >= self.steps


class StepSolution(NamedTuple):
    """A flight that was replayed: actions (K, 2), states (K+1, 5), winding, tolerance used."""

    actions: NDArray[np.float32]
    states: Array
    winding: int
    tolerance_used: float


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
        time_budget: when to stop proving that fewer steps are impossible [s]; 0 leaves the bound of thrust alone.
        raise_on_failure: raise SolveFailed rather than return a result without a flight.

    Raises:
        SolveFailed: with the problem and the result, when no flight was found.
        ValueError: for an unknown scenario or a negative budget.
    """
    if not time_budget >= 0:
        raise ValueError(f"time_budget must be at least 0 s, got {time_budget!r}")
    target = scenario(problem)
    bound = math.ceil(projection_bound(target, target.tolerance) / target.dt - 1e-9)
    reason = impossible(target) or beyond_horizon(target)
    shots = (
        []
        if reason
        else [kind[0] for kind in distinct_optima(coarse_multistart(target, windings, starts=STARTS, slack=COARSE))]
    )
    found = search_steps(target, shots, bound)
    if found is not None:
        steps, reason = len(found.actions), ""
        if bound < steps and time_budget > 0:
            bound, reason = _proven_bound(target, shots[0], steps, bound, time_budget)
        status = Status.PROVEN if bound == steps else Status.BEST_KNOWN
        return FewestSteps(target, steps, *found, bound, status, "" if bound == steps else reason)
    status = Status.INFEASIBLE if impossible(target) else Status.NO_STEPS_FOUND
    if bound > target.max_steps:
        status, reason = Status.INFEASIBLE, _too_late(target, bound)
    elif shots:
        reason = f"The fastest flight found takes about {expected(target, shots[0]):.4g} s of {target.time_limit:g} s."
    nothing = np.zeros((0, 2), np.float32)
    result = FewestSteps(target, math.inf, nothing, np.zeros((0, 5)), 0, math.inf, bound, status, reason)
    if raise_on_failure:
        raise SolveFailed(target, result)
    return result


def _proven_bound(
    target: Scenario, shot: ShootingSolution, steps: int, bound: int, time_budget: float
) -> tuple[int, str]:
    """Return fewer steps than what are impossible, and how the proof ended."""
    # Here, because it leans on numba, which takes longer to import than all the rest.
    from optimal.proof.lower_bound import least_steps, prove_steps

    proof = prove_steps(target, shot, steps, time_budget)
    return max(bound, least_steps(proof)), proof.verdict.value


def _too_late(target: Scenario, bound: int) -> str:
    return (
        f"Any flight needs at least {bound} steps of {target.dt} s, and time_limit = {target.time_limit} s allows "
        f"{target.max_steps}; raise it."
    )


def expected(target: Scenario, shot: ShootingSolution) -> float:
    """Return about how long a flight like `shot` takes when it may end anywhere within the tolerance [s]."""
    costate, tolerance = shot.costates[-1], target.tolerance
    shares = [np.hypot(*costate[0:2]), np.hypot(*costate[2:4]), abs(costate[4])]
    return shot.trajectory.duration - float(np.dot(shares, [tolerance.position, tolerance.speed, tolerance.angle]))


def search_steps(target: Scenario, shots: Sequence[ShootingSolution], bound: int) -> StepSolution | None:
    """Return the flight in the fewest steps that is found near free-time ones; None where there is none.

    Args:
        target: what to fly.
        shots: flights from rest to rest, the fastest first.
        bound: fewer steps than this are impossible.
    """
    best: StepSolution | None = None
    for shot in shots:
        least = max(bound, math.ceil(expected(target, shot) * (1 - COARSE) / target.dt))
        first = max(bound, math.ceil(expected(target, shot) / target.dt))
        count = min(first, target.max_steps if best is None else len(best.actions) - 1)
        if count < least:
            continue
        found = solve_in_steps(target, shot.trajectory, shot.winding, count)
        while found is None and best is None and count < min(first + EXTRA_STEPS, target.max_steps):
            count += 1
            found = solve_in_steps(target, shot.trajectory, shot.winding, count)
        while found is not None:
            best = found
            found = one_step_less(target, shot, best) if len(best.actions) > bound else None
    return best


def one_step_less(target: Scenario, shot: ShootingSolution, best: StepSolution) -> StepSolution | None:
    """Return a flight of at least one step less than the best; with hoops, a second start is the best flight itself.

    Without hoops a second start would be in vain: all led to the same m.
    """
    count = len(best.actions) - 1
    found = solve_in_steps(target, shot.trajectory, shot.winding, count)
    if found is not None or not target.hoops:
        return found
    time, controls = target.dt * np.arange(count + 2.0), target.quadrotor.control(best.actions)
    return solve_in_steps(target, Trajectory(time, best.states, controls, target.quadrotor), best.winding, count)


def solve_in_steps(target: Scenario, flight: Trajectory, winding: int, count: int) -> StepSolution | None:
    """Return a flight of at most `count` steps near another one, flown in the environment; None if none is found.

    Hoops are crossed in the same steps as in that flight, then in those to which the solution presses.
    """
    crossings = crossing_steps(target, flight, count)
    tried: set[tuple[int, ...]] = set()
    guess = program.first_guess(target, flight, count)
    rims = bool(target.hoops) and target.quadrotor.radius > 0
    margins = list(program.RIM_MARGINS) if rims else [0.0]
    while len(crossings) == len(target.hoops) and crossings not in tried and len(tried) < ROUNDS:
        tried.add(crossings)
        shape = program.StepShape(count, tr.limited(target), crossings, rims)
        flown = program.fly(target, shape, winding, guess, margins[0])
        if flown.m <= 1 - ARRIVAL_MARGIN:
            actions = np.clip(target.quadrotor.action(flown.controls), -1, 1).astype(np.float32)
            states = replay_to_goal(target, actions)
            if states is not None:
                return StepSolution(actions[: len(states) - 1], states, winding, math.sqrt(max(flown.m, 0.0)))
            if len(margins) > 1:  # touched a rim between two points looked at
                margins.pop(0)
                tried.discard(crossings)
                continue
        shift = (flown.shares > 1 - PRESSED).astype(int) - (flown.shares < PRESSED)
        crossings = tuple(int(j) for j in np.clip(np.array(crossings, int) + shift, 0, count - 1))
    return None


PRESSED = 0.02
"""A crossing this near to an end of its step, as a share of it, presses to the next one."""


def crossing_steps(target: Scenario, flight: Trajectory, count: int) -> tuple[int, ...]:
    """Return the steps in which a flight, flown in `count` steps, crosses the hoops; fewer where it never meets one."""
    times = crossing_times(flight, target) if target.hoops else np.zeros(0)
    return tuple(int(j) for j in np.clip(np.floor(times / flight.duration * count), 0, count - 1))
