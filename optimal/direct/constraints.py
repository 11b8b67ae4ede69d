"""The constraints besides the dynamics: floor and ceiling, hoops, rims of hoops, arrival.

A constraint is placed as (stage, kind, hoop). Each kind has its expression at a stage, its limits, and a mark for the
rows that are equations. Shooting with free step lengths (`optimal.direct.program`) and the program of environment
steps (`optimal.discrete.program`) share the kinds

    rise    floor <= z[k] + vz[k] h/3 <= ceiling           arc from stage k
    fall    floor <= z[k] - vz[k] h/3 <= ceiling           arc to stage k
    rims    |p - rim|^2 >= (radius + clearance)^2          RIM_POINTS points of the arc from stage k, both rim points

and add their own "crossing" (a hoop is passed) and "arrival" (the goal is reached).

"rise" and "fall" limit the inner control points of the cubic with an arc's end heights and end velocities. The cubic
is a convex combination of these and of the end heights. It differs from the arc by at most
thrust_max rate_max^2 h^4 / 384 (1e-7 m at h = 0.012 s).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.direct.stage_solver import Constraint
from optimal.direct.stages import Stages
from optimal.direct.transcription import geometry, step_function

RIM_POINTS = 4
"""Points of an arc at which the distance to a rim is constrained."""

Placed = tuple[int, str, int]
"""A constraint in its place: stage, kind, hoop."""


class Parameters(NamedTuple):
    """The parameters of a program as symbols: gravity, hoops (4, H), target (6,), rims (4, H).

    The columns of hoops and rims are those of `Geometry`. The target is [x, z, theta, position, speed, angle]: the
    goal, and the tolerances there.
    """

    gravity: Any
    hoops: Any
    target: Any
    rims: Any

    @classmethod
    def symbols(cls, hoop_count: int) -> Parameters:
        """Return new symbols for a number of hoops."""
        hoops, rims = ca.SX.sym("hoops", 4, hoop_count), ca.SX.sym("rims", 4, hoop_count)
        return cls(ca.SX.sym("g"), hoops, ca.SX.sym("target", 6), rims)

    def column(self) -> Any:
        """Return all parameters as one column, in the order of `parameter_values`."""
        return ca.vertcat(self.gravity, ca.vec(self.hoops), self.target, ca.vec(self.rims))


def parameter_values(scenario: Scenario, winding: int) -> Array:
    """Return the values of `Parameters` for a scenario and a number of whole turns, shape (8 H + 7,)."""
    tolerance, arrays = scenario.tolerance, geometry(scenario)
    target = [*scenario.goal, 2 * np.pi * winding, tolerance.position, tolerance.speed, tolerance.angle]
    return np.concatenate([[scenario.quadrotor.gravity], arrays.hoops.T.ravel(), target, arrays.rims.T.ravel()])


class StageSymbols(NamedTuple):
    """The symbols of one stage: all unknowns x, where they are, the stage's number, parameters, the hoop's number."""

    x: Any
    stages: Stages
    k: int
    parameters: Parameters
    hoop: int

    @property
    def state(self) -> Any:
        """The state at the stage, shape (5,)."""
        return self.x[self.stages.states[self.k].tolist()]

    @property
    def arc(self) -> Any:
        """[state, h, thrust, rate] of the step from the stage, shape (8,)."""
        return self.x[self.stages.arcs[self.k].tolist()]


class ConstraintKind(NamedTuple):
    """One kind of constraint.

    Attributes:
        equations: whether each row is an equation.
        expression: returns the column of rows from the symbols of a stage.
        limits: returns lower and upper limits, shape (2, rows), of a scenario, hoop and clearance from the rims [m].
    """

    equations: tuple[bool, ...]
    expression: Callable[[StageSymbols], Any]
    limits: Callable[[Scenario, int, float], Array]


Kinds = Mapping[str, ConstraintKind]


def _rise(at: StageSymbols) -> Any:
    return at.state[1] + at.state[3] * at.x[int(at.stages.departures[at.k])] / 3


def _fall(at: StageSymbols) -> Any:
    return at.state[1] - at.state[3] * at.x[int(at.stages.arrivals[at.k - 1])] / 3


def _height_limits(scenario: Scenario, _hoop: int, _clearance: float) -> Array:
    return np.array(scenario.heights)[:, None]


def _rim_distances(at: StageSymbols) -> Any:
    """Return the squared distances of an arc's points to both rim points, shape (2 RIM_POINTS,)."""
    arc, rims, found = at.arc, at.parameters.rims[:, at.hoop], []
    for i in range(RIM_POINTS):
        place = step_function()(arc[:5], arc[6:], arc[5] * i / RIM_POINTS, at.parameters.gravity)[:2]
        found += [ca.sumsqr(place - rims[:2]), ca.sumsqr(place - rims[2:])]
    return ca.vertcat(*found)


def _rim_limits(scenario: Scenario, _hoop: int, clearance: float) -> Array:
    rows = 2 * RIM_POINTS
    return np.array([np.full(rows, (scenario.quadrotor.radius + clearance) ** 2), np.full(rows, np.inf)])


SHARED_KINDS: dict[str, ConstraintKind] = {
    "rise": ConstraintKind((False,), _rise, _height_limits),
    "fall": ConstraintKind((False,), _fall, _height_limits),
    "rims": ConstraintKind((False,) * 2 * RIM_POINTS, _rim_distances, _rim_limits),
}


def relative_to_hoop(state: Any, hoop: Any) -> Any:
    """Return position and speed of a state (5,) relative to a hoop: along [m], aside [m], speed along [m/s].

    Args:
        state: the state.
        hoop: a column of `Geometry.hoops`, shape (4,).
    """
    offset_x, offset_z = state[0] - hoop[0], state[1] - hoop[1]
    return ca.vertcat(
        offset_x * hoop[2] + offset_z * hoop[3],
        offset_z * hoop[2] - offset_x * hoop[3],
        state[2] * hoop[2] + state[3] * hoop[3],
    )


def arrival_errors(state: Any, target: Any) -> Any:
    """Return the squared errors of position, speed and angle of a state (5,) over squared tolerances, shape (3,)."""
    return ca.vertcat(
        ((state[0] - target[0]) ** 2 + (state[1] - target[1]) ** 2) / target[3] ** 2,
        (state[2] ** 2 + state[3] ** 2) / target[4] ** 2,
        (state[4] - target[2]) ** 2 / target[5] ** 2,
    )


def equations(kinds: Kinds, placed: Sequence[Placed]) -> list[tuple[int, list[bool]]]:
    """Return the stage of each constraint, and whether each of its rows is an equation, as `Stages.rows` takes them."""
    return [(k, list(kinds[kind].equations)) for k, kind, _ in placed]


def expressions(
    kinds: Kinds, placed: Sequence[Placed], x: Any, stages: Stages, parameters: Parameters
) -> list[Constraint]:
    """Return the constraints as symbols, as `optimal.direct.stage_solver.solver` takes them.

    Args:
        kinds: the program's table of kinds.
        placed: its constraints, ordered by stage.
        x: symbols of the unknowns.
        stages: where they are.
        parameters: symbols of the parameters.
    """
    return [
        (k, kinds[kind].expression(StageSymbols(x, stages, k, parameters, hoop)), list(kinds[kind].equations))
        for k, kind, hoop in placed
    ]


def limits(kinds: Kinds, placed: Sequence[Placed], scenario: Scenario, clearance: float = 0.0) -> Array:
    """Return lower and upper limits of all rows, `clearance` metres away from the rims, shape (2, rows)."""
    found = [kinds[kind].limits(scenario, hoop, clearance) for _, kind, hoop in placed]
    return np.concatenate([np.zeros((2, 0)), *found], axis=1)
