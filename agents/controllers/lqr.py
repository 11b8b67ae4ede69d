"""The regulator: which correction a deviation from a flight calls for.

Time-varying and linear-quadratic (Anderson and Moore 1990): with x the deviation of the state from where the flight is
at step k,

    u = u_k - K_k x,   K_k = (R + B' P B)^-1 B' P A,   P_k = Q + A' P A - A' P B K_k,

A and B the derivatives of the exact step there, and P at the end such that a deviation as large as the tolerance
costs 1. Many flights are reckoned at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_are

from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenarios.scenario import Scenario, Tolerance

PUSH = 1e-6
"""Half the difference of states and controls from which derivatives are taken."""
EFFORT = 1.0
"""What a correction as large as half the control's range costs, where one of the state as large as the tolerance
costs 1 at the end."""
DRIFT = 0.002
"""What such a deviation costs at each step on the way."""
HELD = 10.0
"""Factor on the cost of correcting a control that stands at its limit: it can move one way only."""


def regulator(scenario: Scenario, states: Array, controls: Array, last: Any = -1) -> Array:
    """Return the gains about flights, shape (..., K, 2, 5).

    Args:
        scenario: whose vehicle, step and tolerance count.
        states: shape (..., K, 5).
        controls: shape (..., K, 2).
        last: the point from which on each flight hovers at the goal, at K - 1 at the latest, shape (...).
    """
    quadrotor, count = scenario.quadrotor, states.shape[-2]
    a, b = derivatives(quadrotor, states, controls, scenario.dt)
    arrived = terminal_cost(scenario.tolerance)
    half = (quadrotor.control_high - quadrotor.control_low) / 2
    cheap = np.diag(EFFORT / half**2)
    a_end, b_end = a.reshape(-1, 5, 5)[-1], b.reshape(-1, 5, 2)[-1]
    forever = gain(a_end, b_end, cheap, solve_discrete_are(a_end, b_end, DRIFT * arrived, cheap))
    at_limit = np.abs(quadrotor.action(controls)) > 1 - 1e-6
    effort = np.where(at_limit, HELD, 1.0)[..., None] * cheap
    gains, cost = np.empty((*controls.shape, 5)), arrived
    for k in range(count - 1, -1, -1):
        there = a[..., k, :, :], b[..., k, :, :]
        hovers = np.asarray(k >= np.mod(last, count))[..., None, None]
        gains[..., k, :, :] = np.where(hovers, forever, gain(*there, effort[..., k, :, :], cost))
        closed = there[0] - there[1] @ gains[..., k, :, :]
        cost = np.where(hovers, arrived, DRIFT * arrived + there[0].mT @ cost @ closed)
    return gains


def gain(a: Array, b: Array, effort: Array, cost: Array) -> Array:
    """Return the gain of one step, shape (..., 2, 5)."""
    return np.asarray(np.linalg.solve(effort + b.mT @ cost @ b, b.mT @ cost @ a))


def terminal_cost(tolerance: Tolerance) -> Array:
    """Return the cost of a deviation at the goal, 1 at each tolerance, shape (5, 5)."""
    return np.diag(1.0 / np.square(tolerances(tolerance)))


def tolerances(tolerance: Tolerance) -> Array:
    """Return the tolerance of each component of a state, shape (5,)."""
    return np.array([tolerance.position] * 2 + [tolerance.speed] * 2 + [tolerance.angle])


def derivatives(quadrotor: Quadrotor, states: Array, controls: Array, dt: float) -> tuple[Array, Array]:
    """Return the derivatives of the step by state and by control, shapes (..., 5, 5) and (..., 5, 2)."""
    push = PUSH * np.eye(7).reshape(7, *[1] * (states.ndim - 1), 7)
    up, down = (quadrotor.step(states + s * push[..., :5], controls + s * push[..., 5:], dt) for s in (1, -1))
    both = np.moveaxis((up - down) / (2 * PUSH), 0, -1)
    return both[..., :5], both[..., 5:]
