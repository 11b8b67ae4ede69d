"""The parametric program of direct multiple shooting with free step lengths, and its bounds for one scenario.

A flight has one phase more than there are hoops. Phase i has N_i steps of equal, unknown length h_i, and hoop i is
crossed at the node between two phases:

    minimise  sum N_i h_i
    such that X[k+1] = step(X[k], U[k], h_i),  X[0] at rest at the start,
              X[N] at rest at the goal with theta = 2 pi winding,
              (p - c) . d = 0, |(p - c) . across| <= gap, v . d >= CROSSING_SPEED   at each hoop (c, d),
              thrust_min <= f <= thrust_max, |omega| <= rate_max, floor <= z <= ceiling.

Scenarios of one `Shape` share a solver, because building it costs more than solving.
"""

from __future__ import annotations

from dataclasses import dataclass
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
from optimal.direct.stage_solver import COLD, TOUCHING_SHARE, WARM, solver, tightened
from optimal.direct.stages import Indices, Stages
from optimal.direct.transcription import geometry, state_limits

NODES = 100
"""Steps of a whole flight; with 400, T* falls by at most 3e-4 s on the named scenarios, 1.1e-5 s on the horizontals."""
MIN_STEPS = 25
"""Fewest steps of one phase."""
COARSENING = 4
"""Steps of the full grid for each step of the coarse grid."""
MIN_COARSE_STEPS = 12
"""Fewest steps of one phase on the coarse grid."""
CROSSING_SPEED = 1e-3
"""Least speed through a hoop [m/s]. A flight that turns round at a hoop would only touch its line; at this speed it
crosses the line by 1e-8 m or more, which costs up to 1e-4 s."""
LONGEST_PHASE, SHORTEST_STEP = 20.0, 1e-6
"""Longest phase and shortest step that the solver considers [s]."""


@dataclass(frozen=True)
class Shape:
    """What scenarios must have in common to share a solver.

    Attributes:
        steps: steps of each phase.
        limited: whether there is a floor or a ceiling.
        tolerant: whether the flight may end anywhere within the tolerance.
        rims: whether the body must keep clear of the hoops' rims.
    """

    steps: tuple[int, ...]
    limited: bool
    tolerant: bool
    rims: bool = False


class Layout(NamedTuple):
    """The order of unknowns and constraints in a program.

    Attributes:
        stages: places of the unknowns.
        placed: the constraints besides the dynamics.
        gaps: rows of the dynamics, shape (N, 6).
        rows: rows of `placed`, in its order.
        row_count: number of all rows.
    """

    stages: Stages
    placed: list[Placed]
    gaps: Indices
    rows: Indices
    row_count: int


def phase_steps(scenario: Scenario, nodes: int = NODES) -> tuple[int, ...]:
    """Return the number of steps of each phase, in proportion to the lengths of the legs."""
    lengths = geometry(scenario).lengths
    return tuple(max(MIN_STEPS, round(nodes * length / lengths.sum())) for length in lengths)


def coarse_steps(scenario: Scenario, nodes: int = NODES) -> tuple[int, ...]:
    """Return the number of steps of each phase on the coarse grid."""
    return tuple(max(MIN_COARSE_STEPS, -(-count // COARSENING)) for count in phase_steps(scenario, nodes))


def _at_hoop(at: StageSymbols) -> Any:
    return relative_to_hoop(at.state, at.parameters.hoops[:, at.hoop])


def _hoop_limits(scenario: Scenario, hoop: int, _clearance: float) -> Array:
    gap = scenario.hoops[hoop].half_gap(scenario.quadrotor.radius)
    return np.array([[0.0, -gap, CROSSING_SPEED], [0.0, gap, np.inf]])


def _at_goal(at: StageSymbols) -> Any:
    return arrival_errors(at.state, at.parameters.target)


def _goal_limits(_scenario: Scenario, _hoop: int, _clearance: float) -> Array:
    return np.array([np.zeros(3), np.ones(3)])


KINDS = SHARED_KINDS | {
    "crossing": ConstraintKind((True, False, False), _at_hoop, _hoop_limits),
    "arrival": ConstraintKind((False,) * 3, _at_goal, _goal_limits),
}


@lru_cache(maxsize=64)
def program(shape: Shape, warm: bool = False) -> Any:
    """Return the parametric solver of one shape.

    Args:
        shape: what scenarios have in common.
        warm: whether it will be started near a solution.

    Unknowns are placed by `Stages`, parameters by `Parameters`.
    """
    stages, placed = layout(shape)[:2]
    x, parameters = ca.SX.sym("x", stages.size), Parameters.symbols(len(shape.steps) - 1)
    problem = {"x": x, "p": parameters.column(), "f": ca.dot(ca.DM(shape.steps), x[stages.lengths.tolist()])}
    return solver(stages, problem, expressions(KINDS, placed, x, stages, parameters), WARM if warm else COLD)


@lru_cache(maxsize=64)
def layout(shape: Shape) -> Layout:
    """Return the order of unknowns and constraints of a shape."""
    stages, placed = Stages(shape.steps), constraints(shape)
    gaps, rows, marks = stages.rows(equations(KINDS, placed))
    return Layout(stages, placed, gaps, rows, len(marks))


def constraints(shape: Shape) -> list[Placed]:
    """Return the constraints besides the dynamics, ordered by stage, as (stage, kind, hoop)."""
    stages = Stages(shape.steps)
    found = [(int(k), "crossing", i) for i, k in enumerate(stages.firsts[1:])]
    if shape.limited:
        found += [(k, "rise", 0) for k in range(stages.count)]
        found += [(k + 1, "fall", 0) for k in range(stages.count)]
    if shape.rims:
        for i, k in enumerate(stages.firsts[1:]):
            found += [(j, "rims", i) for j in range(int(k) - shape.steps[i] // 2, int(k) + shape.steps[i + 1] // 2)]
    if shape.tolerant:
        found.append((stages.count, "arrival", 0))
    return sorted(found)


def bounds(scenario: Scenario, shape: Shape, winding: int, clearance: float = 0.0) -> dict[str, Array]:
    """Return the bounds and parameters of `program` for one scenario and winding.

    Args:
        scenario: the task.
        shape: of the program.
        winding: whole turns of the tilt.
        clearance: distance that the body keeps from the rims beyond its radius [m].
    """
    stages, placed, _, rows, row_count = layout(shape)
    q = scenario.quadrotor
    low, high = state_limits(scenario, stages.count + 1)
    if not shape.tolerant:
        low[:, -1] = high[:, -1] = scenario.goal_state + 2 * np.pi * winding * np.eye(5)[4]
    low, high = tightened(low, high, TOUCHING_SHARE)
    row_limits = np.zeros((2, row_count))
    least, greatest = limits(KINDS, placed, scenario, clearance)
    row_limits[:, rows] = tightened(least, greatest, TOUCHING_SHARE)
    control_low, control_high = tightened(q.control_low, q.control_high)
    return {
        "lbx": stages.pack(np.full(len(shape.steps), SHORTEST_STEP), low.T, control_low),
        "ubx": stages.pack(LONGEST_PHASE / np.array(shape.steps), high.T, control_high),
        "lbg": row_limits[0],
        "ubg": row_limits[1],
        "p": parameter_values(scenario, winding),
    }
