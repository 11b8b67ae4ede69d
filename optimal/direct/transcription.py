"""What the time-domain programs share: the exact step as symbols, and constraints built on it.

Direct multiple shooting (Bock and Plitt 1984): states at nodes and controls between them are
unknowns, tied by X[k+1] = step(X[k], U[k], h), where `step` is the closed form of
`flatgym.quadrotor`, so that nothing is lost between transcription and environment.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array, exact_step
from flatgym.scenarios.scenario import Scenario
from optimal.flights.trajectory import Flight

RIM_POINTS = 4
"""Points of an arc at which the distance to a rim is constrained."""


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


def crossing(state: Any, hoop: Any) -> Any:
    """Return how a state (5,) stands to a hoop [x, z, direction_x, direction_z]: along, aside, speed along."""
    offset_x, offset_z = state[0] - hoop[0], state[1] - hoop[1]
    return ca.vertcat(
        offset_x * hoop[2] + offset_z * hoop[3],
        offset_z * hoop[2] - offset_x * hoop[3],
        state[2] * hoop[2] + state[3] * hoop[3],
    )


def arrival(state: Any, target: Any) -> Any:
    """Return how far a state (5,) is from a target, in squared tolerances: position, speed, angle; 1 is just arrived.

    `target` is [x, z, theta, position, speed, angle]: where to arrive, and the tolerances.
    """
    return ca.vertcat(
        ((state[0] - target[0]) ** 2 + (state[1] - target[1]) ** 2) / target[3] ** 2,
        (state[2] ** 2 + state[3] ** 2) / target[4] ** 2,
        (state[4] - target[2]) ** 2 / target[5] ** 2,
    )


def arrival_target(scenario: Scenario, winding: int) -> Array:
    """Return the scenario's goal after `winding` turns as `arrival` wants it, shape (6,)."""
    tolerance = scenario.tolerance
    return np.array([*scenario.goal, 2 * np.pi * winding, tolerance.position, tolerance.speed, tolerance.angle])


def hoop_parameters(scenario: Scenario) -> Array:
    """Return the scenario's hoops as `crossing` wants them, shape (4, H)."""
    return np.array([[*hoop.centre, *hoop.direction] for hoop in scenario.hoops]).reshape(-1, 4).T


def crossing_limits(scenario: Scenario, margin: float = 0.0) -> tuple[Array, Array]:
    """Return least and greatest values of `crossing`, `margin` metres inside the gaps, each shape (3 H,)."""
    half = [hoop.half_gap(scenario.quadrotor.radius) - margin for hoop in scenario.hoops]
    low, high = [[0.0, -gap, 0.0] for gap in half], [[0.0, gap, np.inf] for gap in half]
    return np.ravel(low), np.ravel(high)


def state_limits(scenario: Scenario, nodes: int) -> tuple[Array, Array]:
    """Return least and greatest states at the nodes, shape (5, nodes): start fixed, heights kept, the rest free."""
    low, high = np.full((5, nodes), -np.inf), np.full((5, nodes), np.inf)
    low[1], high[1] = scenario.heights
    low[:, 0] = high[:, 0] = scenario.start_state
    return low, high


def limited(scenario: Scenario) -> bool:
    """Return whether there is a floor or a ceiling."""
    return scenario.floor is not None or scenario.ceiling is not None


def legs(scenario: Scenario) -> tuple[Array, Array]:
    """Return the points start, hoop centres, goal, shape (P+1, 2), and the leg lengths [m], shape (P,)."""
    points = np.array([scenario.start, *((hoop.x, hoop.z) for hoop in scenario.hoops), scenario.goal])
    return points, np.maximum(np.hypot(*np.diff(points, axis=0).T), 0.1)


def rim_parameters(scenario: Scenario) -> Array:
    """Return both rim points [x, z, x, z] of each hoop [m], shape (4, H)."""
    return np.array([hoop.rims.ravel() for hoop in scenario.hoops]).reshape(-1, 4).T


def rim_distances(arc: Any, gravity: Any, rims: Any) -> Any:
    """Return the squared distances of an arc's quarter points to two rim points, shape (2 RIM_POINTS,).

    Args:
        arc: [state, h, thrust, rate], shape (8,).
        gravity: gravitational acceleration.
        rims: [x, z, x, z] of the two rim points, shape (4,).
    """
    found = []
    for i in range(RIM_POINTS):
        place = step_function()(arc[:5], arc[6:], arc[5] * i / RIM_POINTS, gravity)[:2]
        found += [ca.sumsqr(place - rims[:2]), ca.sumsqr(place - rims[2:])]
    return ca.vertcat(*found)


def resampled(flight: Flight, time: Array) -> tuple[Array, Array]:
    """Return a flight's states at times (n+1,) [s], shape (n+1, 5), and its mean thrusts between them, shape (n,)."""
    states, dt = flight.state(time), np.diff(time)
    return states, np.mean([flight.control(time[:-1] + share * dt)[:, 0] for share in (0.25, 0.5, 0.75)], axis=0)


def guess_states(scenario: Scenario, share: Array, duration: float, winding: int, bend: Array) -> Array:
    """Return a plain first guess of the states, shape (5, nodes).

    Args:
        scenario: what to fly.
        share: elapsed share of the way at each node, from 0 to 1, shape (nodes,).
        duration: guessed flight time [s].
        winding: whole turns to make on the way.
        bend: amplitudes of half-sine detours in x [m], z [m] and theta [rad], shape (3,).

    The polyline through the hoops at even speed, the tilt turning evenly, and a detour on top.
    """
    points, lengths = legs(scenario)
    knots = np.append(0.0, np.cumsum(lengths)) / lengths.sum()
    arch = np.sin(np.pi * share)
    states = np.zeros((5, len(share)))
    for i in range(2):
        states[i] = np.interp(share, knots, points[:, i]) + bend[i] * arch
        states[2 + i] = np.gradient(states[i], share) / duration
    states[4] = 2 * np.pi * winding * share + bend[2] * arch
    states[2:4, [0, -1]] = 0.0
    return states
