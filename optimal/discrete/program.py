"""The program of K environment steps: the smallest scale of the tolerance at the goal that K steps can reach.

For a fixed number of steps K the program has what the environment has: constant control over dt, a round tolerance at
the goal, and hoops crossed anywhere inside a step:

    minimise  m
    such that |p - goal|^2 <= m position^2,  |v|^2 <= m speed^2,  (theta - 2 pi w)^2 <= m angle^2,
              X[k+1] = step(X[k], U[k], dt),  limits and heights,
              hoop i crossed at the share s_i of step j_i, 0 <= s_i <= 1, within its gap, in its direction.

K steps are enough when m <= 1. The shares s_i are unknowns. A flight may therefore cross a hoop and return to the other
side in one step, and no division by a speed makes derivatives grow without limit. A crossing depends on the unknowns
of its step only. Every constraint therefore belongs to one stage, and `optimal.direct.stage_solver` solves this program
too. s_i belongs to stage j_i, and m to the last stage.
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
from optimal.direct.solver_process import call
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
"""Settings of the solver. It starts from a flight of about the same duration that stops at the goal or within the
tolerance. What converges does so within 60 iterations."""
HOOP_MARGIN = 5e-5
"""Distance of a planned crossing from the ends of the gap, a quarter of the gap at most [m]. Float32 actions move the
path by 3e-5 m in 8 s."""
CROSSING_SPEED = 0.02
"""Least speed through a hoop [m/s]. A flight that turns round at a hoop would only touch its line; at this speed it
crosses the line by 1e-5 m or more."""
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


def _at_crossing(at: StageSymbols) -> Any:
    """Return the distance along a hoop, the offset and the speed along at the crossing, shape (3,)."""
    arc, hoop = at.arc, at.parameters.hoops[:, at.hoop]
    time = at.x[int(at.stages.further[at.hoop])] * arc[5]
    return relative_to_hoop(step_function()(arc[:5], arc[6:], time, at.parameters.gravity), hoop)


def _hoop_limits(target: Scenario, hoop: int, _clearance: float) -> Array:
    half = target.hoops[hoop].half_gap(target.quadrotor.radius)
    gap = half - min(HOOP_MARGIN, half / 2)
    return np.array([[0.0, -gap, CROSSING_SPEED], [0.0, gap, np.inf]])


def _at_goal(at: StageSymbols) -> Any:
    return arrival_errors(at.state, at.parameters.target) - at.x[int(at.stages.further[-1])]


def _goal_limits(_target: Scenario, _hoop: int, _clearance: float) -> Array:
    return np.array([np.full(3, -np.inf), np.zeros(3)])


KINDS = SHARED_KINDS | {
    "crossing": ConstraintKind((True, False, False), _at_crossing, _hoop_limits),
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


def stages_of(shape: StepShape) -> Stages:
    """Return the places of the unknowns; the further ones are the share of each crossing in its step, and m."""
    return Stages((shape.steps,), (*shape.crossings, shape.steps))


@lru_cache(maxsize=24)  # of 5 to 8 MB each
def program(shape: StepShape) -> Any:
    """Return the parametric solver of one shape: unknowns as `stages_of` places them; `Parameters`."""
    stages, placed = stages_of(shape), list(constraints(shape))
    x, parameters = ca.SX.sym("x", stages.size), Parameters.symbols(len(shape.crossings))
    problem = {"x": x, "p": parameters.column(), "f": x[int(stages.further[-1])]}
    return solver(stages, problem, expressions(KINDS, placed, x, stages, parameters), OPTIONS)


def bounds(target: Scenario, shape: StepShape, winding: int, clearance: float = 0.0) -> dict[str, Array]:
    """Return the bounds and parameters of `program` for one scenario and winding.

    Args:
        target: the task.
        shape: of the program.
        winding: whole turns of the tilt.
        clearance: distance that the body keeps from the rims beyond its radius [m].
    """
    stages, placed, dt = stages_of(shape), list(constraints(shape)), np.array([target.dt])
    low, high = state_limits(target, shape.steps + 1)
    control_low, control_high = tightened(target.quadrotor.control_low, target.quadrotor.control_high)
    _, rows, marks = stages.rows(equations(KINDS, placed))
    row_limits = np.zeros((2, len(marks)))
    row_limits[:, rows] = limits(KINDS, placed, target, clearance)
    shares = np.ones(len(shape.crossings))
    return {
        "lbx": stages.pack(dt, low.T, control_low, 0.0),
        "ubx": stages.pack(dt, high.T, control_high, [*shares, LARGEST_SCALE]),
        "lbg": row_limits[0],
        "ubg": row_limits[1],
        "p": parameter_values(target, winding),
    }


def first_guess(target: Scenario, flight: Flight, shape: StepShape) -> Array:
    """Return a guess for `program`: a free-time flight sampled at equal steps, with steps of dt instead."""
    time = np.linspace(0.0, flight.duration, shape.steps + 1)
    states, thrust = resampled(flight, time)
    controls = np.stack([thrust, np.diff(states[:, 4]) / time[1]], axis=-1)
    shares = [_chord_share(target, i, states[j : j + 2, :2]) for i, j in enumerate(shape.crossings)]
    return stages_of(shape).pack(np.array([target.dt]), states, controls, [*shares, 1.0])


def _chord_share(target: Scenario, hoop: int, ends: Array) -> float:
    """Return the instant, as a share of a step, at which the chord between its ends (2, 2) crosses a hoop's line."""
    before, after = (ends - target.hoops[hoop].centre) @ target.hoops[hoop].direction
    return float(-before / (after - before)) if before < 0 < after else 0.5


def solve_program(target: Scenario, shape: StepShape, winding: int, guess: Array, clearance: float = 0.0) -> StepFlight:
    """Solve `program` once from a guess; see `bounds` for the arguments."""
    stages = stages_of(shape)
    found = call(program, (shape,), x0=guess, **bounds(target, shape, winding, clearance))
    *shares, m = found.x[stages.further]
    return StepFlight(float(m) if found.converged else np.inf, found.x[stages.controls], np.array(shares))
