"""The environment's own optimum K*: the fewest steps of dt that end within the tolerance.

For a fixed number of steps K everything is as the environment has it - constant control over dt,
a round tolerance at the goal, hoops crossed anywhere inside a step - and the program asks how
small the tolerance could be made:

    minimise  m
    such that |p - goal|^2 <= m position^2,  |v|^2 <= m speed^2,  (theta - 2 pi w)^2 <= m angle^2,
              X[k+1] = step(X[k], U[k], dt),  limits and heights,
              hoop i crossed tau_i seconds into step j_i.

K steps are enough when m <= 1. The time in which the tolerance can be reached with free step
lengths gives the first K to try; from there K grows until a flight is found, and what is found
counts only after its float32 actions have been flown in the environment to the outcome "goal".
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from flatgym import task
from flatgym.catalogue import ScenarioLike, scenario
from flatgym.quadrotor import Array
from flatgym.scenario import Scenario
from flatgym.scene import GOAL
from optimal import transcription as tr
from optimal.bounds import projection_bound
from optimal.certificate import crossing_times
from optimal.feasibility import impossible
from optimal.search import search
from optimal.shooting import WINDINGS, Shot
from optimal.solution import SolveFailed, Status

HOOP_MARGIN = 1e-5
"""How far inside a gap a planned crossing stays [m]: float32 actions move the path by less."""
ARRIVAL_MARGIN = 1e-3
"""How far below 1 the smallest tolerance m must be, for the same reason."""
EXTRA_STEPS = 5
"""How many K are tried, beginning with the first that free step lengths allow."""


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
        reason: where there is no flight, what stands in its way, as far as known; else empty.
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


def fewest_steps(problem: ScenarioLike, *, windings: Sequence[int] = WINDINGS, throw: bool = True) -> FewestSteps:
    """Return the fewest environment steps in which a flight of the scenario is found.

    Args:
        problem: a scenario or its name.
        windings: whole turns to try.
        throw: raise SolveFailed rather than return a result without a flight.

    Raises:
        SolveFailed: with the problem and the result, when no flight was found.
        ValueError: for an unknown scenario.
    """
    target = scenario(problem)
    reason = impossible(target)
    shots = () if reason else search(target, windings=windings, tolerant=True).shots
    bound = math.ceil(projection_bound(target, target.tolerance) / target.dt - 1e-9)
    if shots:
        first = math.ceil(shots[0].trajectory.duration / target.dt - 1e-9)
        for count in range(first, min(first + EXTRA_STEPS, target.max_steps + 1)):
            for shot in shots:
                if shot.trajectory.duration <= count * target.dt + 1e-9:
                    found = _fly_in(target, shot, count)
                    if found is not None:
                        return FewestSteps(target, count, *found, bound, Status.BEST_KNOWN)
    nothing = np.zeros((0, 2), np.float32)
    status = Status.INFEASIBLE if reason else Status.NO_STEPS_FOUND
    if bound > target.max_steps:
        status, reason = Status.INFEASIBLE, _too_late(target, bound)
    elif not reason and shots:
        reason = f"The fastest flight found takes {shots[0].trajectory.duration:.4g} s of {target.time_limit:g} s."
    result = FewestSteps(target, math.inf, nothing, np.zeros((0, 5)), 0, math.inf, bound, status, reason)
    if throw:
        raise SolveFailed(target, result)
    return result


def _too_late(target: Scenario, bound: int) -> str:
    return (
        f"Any flight needs at least {bound} steps of {target.dt} s, and time_limit = {target.time_limit} s allows "
        f"{target.max_steps}; raise it."
    )


def _fly_in(target: Scenario, shot: Shot, count: int) -> tuple[NDArray[np.float32], Array, int, float] | None:
    """Look for a flight in `count` steps near a free-time one; return actions, states, winding, tolerance used."""
    solver = program(count, len(target.hoops), tr.limited(target))
    for crossings in _crossing_steps(target, shot, count):
        result = solver(x0=_first_guess(target, shot, crossings, count), **_bounds(target, shot, crossings, count))
        values = np.array(result["x"]).ravel()
        if solver.stats()["return_status"] not in tr.SUCCESS or values[0] > 1 - ARRIVAL_MARGIN:
            continue
        controls = values[1 + 5 * (count + 1) :][: 2 * count].reshape(count, 2)
        actions = np.clip(target.quadrotor.action(controls), -1, 1).astype(np.float32)
        states = replay(target, actions)
        if states is not None:
            return actions, states, shot.winding, math.sqrt(values[0])
    return None


def replay(target: Scenario, actions: NDArray[np.float32]) -> Array | None:
    """Fly actions (K, 2) by the environment's own verbs; return the states (K+1, 5).

    None unless the flight reaches the goal with the last action and not before.
    """
    flown = task.fly_actions(target, actions)
    arrived = len(flown) == len(actions) + 1 and flown[-1].outcome[0] == GOAL
    return np.array([situation.state[0] for situation in flown]) if arrived else None


@lru_cache(maxsize=64)
def program(count: int, hoop_count: int, limited: bool) -> Any:
    """Return the parametric solver for `count` steps.

    Unknowns in this order: m, X (5, K+1) and U (2, K) by columns, and for each hoop the state and
    the control at the beginning of the step that crosses it (7,) and the time within it (1,);
    parameters: gravity, dt, hoops (4, H), target (6,), one column of K zeros and a one for each
    hoop that picks the crossing step; constraints: step gaps (5 K,), heights (2 K,) if limited,
    picked minus copied (7 H,), crossings (3 H,), arrival minus m (3,).
    """
    states, controls, m = ca.MX.sym("X", 5, count + 1), ca.MX.sym("U", 2, count), ca.MX.sym("m")
    copies = ca.MX.sym("Y", 8, hoop_count)
    gravity, dt, target = ca.MX.sym("g"), ca.MX.sym("dt"), ca.MX.sym("target", 6)
    hoops, picks = ca.MX.sym("hoops", 4, hoop_count), ca.MX.sym("picks", count, hoop_count)
    lengths = ca.repmat(dt, 1, count)
    constraints = [tr.gaps(states, controls, lengths, gravity)]
    if limited:
        constraints.append(tr.heights(states, lengths))
    # The copies keep the Hessian sparse: the crossing is nonlinear in 8 unknowns, not in all.
    constraints.append(ca.vec(ca.vertcat(states[:, :-1], controls) @ picks - copies[:7, :]))
    for i in range(hoop_count):
        inside = tr.step_function()(copies[:5, i], copies[5:7, i], copies[7, i], gravity)
        constraints.append(tr.crossing(inside, hoops[:, i]))
    constraints.append(tr.arrival(states[:, -1], target) - m)
    unknowns = [m, ca.vec(states), ca.vec(controls), ca.vec(copies)]
    problem = {
        "x": ca.vertcat(*unknowns),
        "p": ca.vertcat(gravity, dt, ca.vec(hoops), target, ca.vec(picks)),
        "f": m,
        "g": ca.vertcat(*constraints),
    }
    return ca.nlpsol("steps", "ipopt", problem, {"expand": True, **tr.IPOPT})


def _bounds(target: Scenario, shot: Shot, crossings: Sequence[int], count: int) -> dict[str, Array]:
    low, high = tr.state_limits(target, count + 1)
    q, hoop_count = target.quadrotor, len(target.hoops)
    floor, ceiling = tr.height_limits(target)
    heights = 2 * count * tr.limited(target)
    crossing_low, crossing_high = tr.crossing_limits(target, HOOP_MARGIN)
    copy_low, copy_high = np.append(np.full(7, -np.inf), 0.0), np.append(np.full(7, np.inf), target.dt)
    zeros = np.zeros(7 * hoop_count)
    picks = np.eye(count)[list(crossings)]
    parameters = [[q.gravity, target.dt], tr.hoop_parameters(target).T.ravel(), tr.arrival_target(target, shot.winding)]
    return {
        "lbx": np.concatenate([[0.0], low.T.ravel(), np.tile(q.control_low, count), np.tile(copy_low, hoop_count)]),
        "ubx": np.concatenate([[1e6], high.T.ravel(), np.tile(q.control_high, count), np.tile(copy_high, hoop_count)]),
        "lbg": np.concatenate([np.zeros(5 * count), np.full(heights, floor), zeros, crossing_low, np.full(3, -np.inf)]),
        "ubg": np.concatenate([np.zeros(5 * count), np.full(heights, ceiling), zeros, crossing_high, np.zeros(3)]),
        "p": np.concatenate([*parameters, picks.ravel()]),
    }


def _first_guess(target: Scenario, shot: Shot, crossings: Sequence[int], count: int) -> Array:
    """Return the free-time flight, sampled at `count` even steps, as a start for `program`."""
    flight = shot.trajectory
    time = np.linspace(0.0, flight.duration, count + 1)
    states, thrust = tr.resampled(flight, time)
    controls = np.stack([thrust, np.diff(states[:, 4]) / time[1]], axis=-1)
    copies = [np.append(np.append(states[j], controls[j]), target.dt / 2) for j in crossings]
    return np.concatenate([[1.0], states.ravel(), controls.ravel(), *copies])


def _crossing_steps(target: Scenario, shot: Shot, count: int) -> Iterator[tuple[int, ...]]:
    """Yield the steps in which each hoop may be crossed: as in the free-time flight, then one off at one hoop."""
    times = crossing_times(shot.trajectory, target)
    if len(times) < len(target.hoops):  # grazed rather than crossed: no step to begin with
        return
    base = np.clip(np.floor(times / shot.trajectory.duration * count), 0, count - 1).astype(int)
    yield tuple(map(int, base))
    for i in range(len(base)):
        for shift in (-1, 1):
            moved = base.copy()
            moved[i] += shift
            if 0 <= moved[i] < count:
                yield tuple(map(int, moved))
