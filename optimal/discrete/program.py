"""The program of K environment steps: the smallest scale of the tolerance at the goal that K steps can reach.

For a fixed number of steps K the program has what the environment has: constant control over dt, a round tolerance at
the goal, and hoops crossed anywhere inside a step:

    minimise  m
    such that |p - goal|^2 <= m position^2,  |v|^2 <= m speed^2,  (theta - 2 pi w)^2 <= m angle^2,
              X[k+1] = step(X[k], U[k], dt),  limits and heights,
              hoop i crossed inside step j_i, within its gap, in its direction.

K steps are enough when m <= 1. One step of Newton's method from the chord gives the instant and the offset at which
step j crosses the line of a hoop, exact to a micrometre. It depends on the unknowns of that step only. Every
constraint therefore belongs to one stage, and `optimal.direct.stage_solver` solves this program too. m belongs to the
last stage.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.direct.constraints import (
    SHARED_KINDS,
    ConstraintKind,
    Parameters,
    Placed,
    StageSymbols,
    arrival_errors,
    equations,
    expressions,
    limits,
    parameter_values,
    relative_to_hoop,
)
from optimal.direct.stage_solver import WARM, solver, tightened
from optimal.direct.stages import Stages
from optimal.direct.transcription import resampled, state_limits, step_function
from optimal.flights.trajectory import Flight

OPTIONS = WARM | {
    "fatrop.tol": 1e-7,
    "fatrop.mu_init": 1e-3,
    "fatrop.bound_push": 1e-3,
    "fatrop.bound_frac": 1e-3,
    "fatrop.max_iter": 64,
}
"""Settings of the solver. It starts from a flight of about the same duration that stops exactly at the goal. What
converges does so within 60 iterations. On infeasible programs Fatrop's restoration has been seen never to return; a
low limit of iterations makes that rare."""
HOOP_MARGIN = 1e-5
"""Distance of a planned crossing from the ends of the gap [m]: float32 actions move the path by less."""
SMALLEST_DIVISOR = 1e-3
"""Speed [m/s] and length of a step [m] towards a hoop below which the instant of its passage is not resolved."""
RIM_MARGINS = (1e-3, 5e-3)
"""Distances beyond its radius that the body keeps from the rims at the constrained points [m], tried in this order:
between points 5 cm apart a body of radius 0.1 m can dip in by 3 mm, but most flights keep a larger distance anyway."""
RIM_REACH = 8
"""Steps before and after a crossing in which the distance to the rims is constrained."""
LARGEST_SCALE = 1e6
"""Largest m considered."""


class StepShape(NamedTuple):
    """What tasks must have in common to share a solver.

    Attributes:
        steps: K.
        limited: whether there is a floor or a ceiling.
        crossings: the step in which each hoop is crossed.
        rims: whether the body must keep clear of the hoops' rims.
    """

    steps: int
    limited: bool
    crossings: tuple[int, ...] = ()
    rims: bool = False


class StepFlight(NamedTuple):
    """The result of one solve.

    Attributes:
        m: scale of the squared tolerances; inf where the solve failed.
        controls: thrust and rate of each step, shape (K, 2).
        shares: instant of each hoop's crossing as a share of its step, shape (H,).
    """

    m: float
    controls: Array
    shares: Array


def _inverse(value: Any) -> Any:
    """Return 1 / value, relatively less by (SMALLEST_DIVISOR / value)^2, and 0 for 0: the guess may rest on a hoop."""
    return value / (value**2 + SMALLEST_DIVISOR**2)


def _inside_step(at: StageSymbols) -> Any:
    """Return the distance along a hoop before and after the step, and offset and speed along at the crossing, (4,)."""
    arc, gravity, hoop = at.arc, at.parameters.gravity, at.parameters.hoops[:, at.hoop]
    before = relative_to_hoop(arc[:5], hoop)
    after = relative_to_hoop(step_function()(arc[:5], arc[6:], arc[5], gravity), hoop)
    chord = -arc[5] * before[0] * _inverse(after[0] - before[0])
    near = relative_to_hoop(step_function()(arc[:5], arc[6:], chord, gravity), hoop)
    time = chord - near[0] * _inverse(near[2])
    there = relative_to_hoop(step_function()(arc[:5], arc[6:], time, gravity), hoop)
    return ca.vertcat(before[0], after[0], there[1:])


def _hoop_limits(target: Scenario, hoop: int, _clearance: float) -> Array:
    gap = target.hoops[hoop].half_gap(target.quadrotor.radius) - HOOP_MARGIN
    return np.array([[-np.inf, 0.0, -gap, 0.0], [0.0, np.inf, gap, np.inf]])


def _at_goal(at: StageSymbols) -> Any:
    return arrival_errors(at.state, at.parameters.target) - at.x[at.stages.size]


def _goal_limits(_target: Scenario, _hoop: int, _clearance: float) -> Array:
    return np.array([np.full(3, -np.inf), np.zeros(3)])


KINDS = SHARED_KINDS | {
    "crossing": ConstraintKind((False,) * 4, _inside_step, _hoop_limits),
    "arrival": ConstraintKind((False,) * 3, _at_goal, _goal_limits),
}


def constraints(shape: StepShape) -> Iterator[Placed]:
    """Yield the constraints besides the dynamics, ordered by stage, as (stage, kind, hoop)."""
    for k in range(shape.steps + 1):
        if shape.limited and k < shape.steps:
            yield k, "rise", 0
        if shape.limited and k > 0:
            yield k, "fall", 0
        for i, j in enumerate(shape.crossings):
            if k == j:
                yield k, "crossing", i
            if shape.rims and abs(k - j) <= RIM_REACH and k < shape.steps:
                yield k, "rims", i
    yield shape.steps, "arrival", 0


@lru_cache(maxsize=24)  # of 5 to 8 MB each; joblib replaces workers that have grown by 300 MB, which takes seconds
def program(shape: StepShape) -> Any:
    """Return the parametric solver of one shape: unknowns as `Stages` places them, then m; `Parameters`."""
    stages, placed = Stages((shape.steps,)), list(constraints(shape))
    x, parameters = ca.SX.sym("x", stages.size + 1), Parameters.symbols(len(shape.crossings))
    problem = {"x": x, "p": parameters.column(), "f": x[stages.size]}
    return solver(stages, problem, expressions(KINDS, placed, x, stages, parameters), OPTIONS)


def bounds(target: Scenario, shape: StepShape, winding: int, clearance: float = 0.0) -> dict[str, Array]:
    """Return the bounds and parameters of `program` for one scenario and winding.

    Args:
        target: the task.
        shape: of the program.
        winding: whole turns of the tilt.
        clearance: distance that the body keeps from the rims beyond its radius [m].
    """
    stages, placed, dt = Stages((shape.steps,)), list(constraints(shape)), np.array([target.dt])
    low, high = state_limits(target, shape.steps + 1)
    control_low, control_high = tightened(target.quadrotor.control_low, target.quadrotor.control_high)
    _, rows, marks = stages.rows(equations(KINDS, placed))
    row_limits = np.zeros((2, len(marks)))
    row_limits[:, rows] = limits(KINDS, placed, target, clearance)
    return {
        "lbx": np.append(stages.pack(dt, low.T, control_low), 0.0),
        "ubx": np.append(stages.pack(dt, high.T, control_high), LARGEST_SCALE),
        "lbg": row_limits[0],
        "ubg": row_limits[1],
        "p": parameter_values(target, winding),
    }


def first_guess(target: Scenario, flight: Flight, count: int) -> Array:
    """Return a guess for `program`: a free-time flight sampled at `count` equal steps, with steps of dt instead."""
    time = np.linspace(0.0, flight.duration, count + 1)
    states, thrust = resampled(flight, time)
    controls = np.stack([thrust, np.diff(states[:, 4]) / time[1]], axis=-1)
    return np.append(Stages((count,)).pack(np.array([target.dt]), states, controls), 1.0)


def solve_program(target: Scenario, shape: StepShape, winding: int, guess: Array, clearance: float = 0.0) -> StepFlight:
    """Solve `program` once from a guess; see `bounds` for the arguments."""
    run, stages = program(shape), Stages((shape.steps,))
    result = run(x0=guess, **bounds(target, shape, winding, clearance))
    values = np.array(result["x"]).ravel()
    controls, shares = values[stages.controls], np.zeros(len(shape.crossings))
    for i, j in enumerate(shape.crossings):
        ends = (values[stages.states[k]][:2] - target.hoops[i].centre for k in (j, j + 1))
        before, after = (float(end @ target.hoops[i].direction) for end in ends)
        shares[i] = -before / max(after - before, 1e-12)
    return StepFlight(float(values[-1]) if run.stats()["success"] else np.inf, controls, shares)
