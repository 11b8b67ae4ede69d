"""Time-varying LQR around an optimal flight (Anderson and Moore 1990).

With x the deviation of the state from the flight at step k,

    u = u_k - K_k x,   K_k = (R + B' P B)^-1 B' P A,   P_k = Q + A' P A - A' P B K_k.

A and B are the derivatives of the exact step at that point. The terminal cost P is 1 for a deviation as large as the
goal tolerance. The Riccati recursion runs over a batch of flights.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_are

from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenarios.scenario import Scenario, Tolerance

FD_STEP = 1e-6
"""Step of the central differences for A and B, in the units of states and controls."""
CONTROL_COST = 1.0
"""Cost R of a correction of half the control range; a deviation of one tolerance costs 1 at the end."""
STAGE_COST = 0.002
"""Cost Q of a deviation of one tolerance at each step before the end."""
SATURATED_COST = 10.0
"""Factor on R where the control is at a limit, because only one direction of correction is left."""


def tvlqr_gains(scenario: Scenario, states: Array, controls: Array, last: Any = -1) -> Array:
    """Return the feedback gains K along flights, shape (..., K, 2, 5).

    Args:
        scenario: gives vehicle, step and tolerance.
        states: shape (..., K, 5).
        controls: shape (..., K, 2).
        last: the point from which each flight hovers at the goal, at most K - 1, shape (...).
    """
    quadrotor, count = scenario.quadrotor, states.shape[-2]
    a, b = derivatives(quadrotor, states, controls, scenario.dt)
    arrived = terminal_cost(scenario.tolerance)
    half = (quadrotor.control_high - quadrotor.control_low) / 2
    r = np.diag(CONTROL_COST / half**2)
    a_end, b_end = a.reshape(-1, 5, 5)[-1], b.reshape(-1, 5, 2)[-1]
    steady_gain = gain(a_end, b_end, r, solve_discrete_are(a_end, b_end, STAGE_COST * arrived, r))
    at_limit = np.abs(quadrotor.action(controls)) > 1 - 1e-6
    effort = np.where(at_limit, SATURATED_COST, 1.0)[..., None] * r
    gains, cost = np.empty((*controls.shape, 5)), arrived
    for k in range(count - 1, -1, -1):
        a_k, b_k = a[..., k, :, :], b[..., k, :, :]
        hovers = np.asarray(k >= np.mod(last, count))[..., None, None]
        gains[..., k, :, :] = np.where(hovers, steady_gain, gain(a_k, b_k, effort[..., k, :, :], cost))
        closed_loop = a_k - b_k @ gains[..., k, :, :]
        cost = np.where(hovers, arrived, STAGE_COST * arrived + a_k.mT @ cost @ closed_loop)
    return gains


def gain(a: Array, b: Array, effort: Array, cost: Array) -> Array:
    """Return the gain K of one step from A, B, R and P, shape (..., 2, 5)."""
    return np.asarray(np.linalg.solve(effort + b.mT @ cost @ b, b.mT @ cost @ a))


def terminal_cost(tolerance: Tolerance) -> Array:
    """Return the cost matrix at the goal, 1 at each tolerance, shape (5, 5)."""
    return np.diag(1.0 / np.square(tolerances(tolerance)))


def tolerances(tolerance: Tolerance) -> Array:
    """Return the tolerance of each component of a state, shape (5,) [m, m, m/s, m/s, rad]."""
    return np.array([tolerance.position] * 2 + [tolerance.speed] * 2 + [tolerance.angle])


def derivatives(quadrotor: Quadrotor, states: Array, controls: Array, dt: float) -> tuple[Array, Array]:
    """Return A and B, the derivatives of the step by state and by control, shapes (..., 5, 5) and (..., 5, 2)."""
    offsets = FD_STEP * np.eye(7).reshape(7, *[1] * (states.ndim - 1), 7)
    up, down = (quadrotor.step(states + s * offsets[..., :5], controls + s * offsets[..., 5:], dt) for s in (1, -1))
    both = np.moveaxis((up - down) / (2 * FD_STEP), 0, -1)
    return both[..., :5], both[..., 5:]
