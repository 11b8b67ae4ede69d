"""What the time-domain programs share: the exact step as symbols, the scenario as arrays, bounds of the states.

Direct multiple shooting (Bock and Plitt 1984): the unknowns are the states at nodes and the controls between them,
tied by X[k+1] = step(X[k], U[k], h). The environment flies the same closed form of `flatgym.quadrotor`. The
transcription therefore adds no integration error.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array, exact_step
from flatgym.scenarios.scenario import Scenario
from optimal.flights.trajectory import Flight

MIN_LEG = 0.1
"""Least length that a leg counts with [m]: a phase of no length has no step length."""


class _Symbols:
    """The operations the exact step needs, on CasADi symbols."""

    sin = staticmethod(ca.sin)
    cos = staticmethod(ca.cos)
    where = staticmethod(ca.if_else)


@lru_cache(maxsize=1)
def step_function() -> Any:
    """Return the exact step as a CasADi function: state (5,), control (2,), h, gravity -> state (5,)."""
    state, control, h, gravity = ca.SX.sym("state", 5), ca.SX.sym("control", 2), ca.SX.sym("h"), ca.SX.sym("g")
    after = exact_step(ca.vertsplit(state), ca.vertsplit(control), h, gravity, _Symbols)
    return ca.Function("step", [state, control, h, gravity], [ca.vertcat(*after)])


@dataclass(frozen=True)
class Geometry:
    """The geometry of a scenario as read-only arrays.

    Attributes:
        points: start, hoop centres and goal [m], shape (H+2, 2).
        lengths: lengths of the legs between them, at least MIN_LEG [m], shape (H+1,).
        hoops: centre [m] and direction [x, z, direction_x, direction_z] of each hoop, shape (4, H).
        rims: both rim points [x, z, x, z] of each hoop [m], shape (4, H).
    """

    points: Array
    lengths: Array
    hoops: Array
    rims: Array


@lru_cache(maxsize=256)
def geometry(scenario: Scenario) -> Geometry:
    """Return the geometry of a scenario; computed once."""
    points = np.array([scenario.start, *((hoop.x, hoop.z) for hoop in scenario.hoops), scenario.goal])
    arrays = (
        points,
        np.maximum(np.hypot(*np.diff(points, axis=0).T), MIN_LEG),
        np.array([[*hoop.centre, *hoop.direction] for hoop in scenario.hoops]).reshape(-1, 4).T,
        np.array([hoop.rims.ravel() for hoop in scenario.hoops]).reshape(-1, 4).T,
    )
    for array in arrays:
        array.flags.writeable = False
    return Geometry(*arrays)


def has_height_limits(scenario: Scenario) -> bool:
    """Return whether there is a floor or a ceiling."""
    return scenario.floor is not None or scenario.ceiling is not None


def state_limits(scenario: Scenario, nodes: int) -> tuple[Array, Array]:
    """Return lower and upper bounds of the states at the nodes, shape (5, nodes).

    The start state is fixed, heights are limited, everything else is free.
    """
    low, high = np.full((5, nodes), -np.inf), np.full((5, nodes), np.inf)
    low[1], high[1] = scenario.heights
    low[:, 0] = high[:, 0] = scenario.start_state
    return low, high


def resampled(flight: Flight, time: Array) -> tuple[Array, Array]:
    """Return a flight's states at times (n+1,) [s], shape (n+1, 5), and its mean thrusts between them, shape (n,)."""
    states, dt = flight.state(time), np.diff(time)
    return states, np.mean([flight.control(time[:-1] + share * dt)[:, 0] for share in (0.25, 0.5, 0.75)], axis=0)
