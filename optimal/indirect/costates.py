"""Costates of a direct solution: is its Hamiltonian constant, and do its controls agree with the switching functions?

With costates (r, q, p) of position, velocity and tilt, e = (sin theta, cos theta) and e' = (cos theta, -sin theta),

    H = r . v + q . (f e - g e_z) + p omega.

A time-optimal flight has H = 1 throughout, and at every instant the controls that maximise H: thrust_max where
q . e > 0, thrust_min where q . e < 0, and the rate at the limit given by the sign of p. Where the rate is at no limit,
the tilt is along q.

The multipliers of a direct solution are costates without further error. Its step is the exact flow under held
controls, so the multiplier of step k is the costate at the end of that step. Within a step q is linear in time and H
is constant. The change of H between steps, and the missed signs, measure the loss from holding controls over a step.
Both vanish with the step length. A control that switches within a step changes H to first order in that length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenarios.scenario import Scenario
from optimal.direct.shooting import ShootingSolution

AT_BOUND = 5e-3
"""Distance from a bound, relative to the width of the range, at which a control counts as being at the bound. An
interior-point method stays away from a bound whose multiplier is small, for example at the ends of singular arcs."""
SIGN_TOLERANCE = 1e-8
"""Magnitude of a switching function below which its sign is not checked [s and s^2/m]."""
POINTS = 8
"""Instants of a step at which signs and angles are evaluated."""

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class CostateReport:
    """How well a direct solution satisfies Pontryagin's conditions; inf (agreement: 0) if it did not converge.

    Attributes:
        hamiltonian_drift: range of the Hamiltonian over the steps, divided by its mean.
        switching_agreement: share of the flight time at which thrust is at the bound given by the sign of q . e and
            the rate, if at a bound, is at the one given by the sign of p.
        singular_residual: angle from the tilt to q, modulo pi, averaged over each step; root mean square over the
            steps whose rate and whose neighbours' rates are at no bound [rad]; 0 without such steps.
    """

    hamiltonian_drift: float = math.inf
    switching_agreement: float = 0.0
    singular_residual: float = math.inf


def hamiltonian(state: Array, control: Array, costate: Array, quadrotor: Quadrotor) -> Array:
    """Return H of states (..., 5), controls (..., 2) and costates (..., 5), shape (...)."""
    return np.sum(costate * quadrotor.derivative(state, control), axis=-1)


def inner_rates(control: Array, quadrotor: Quadrotor) -> Flags:
    """Return where the rate of controls (..., 2) is at neither limit, shape (...)."""
    return np.abs(control[..., 1]) < quadrotor.rate_max * (1 - 2 * AT_BOUND)


def switching_functions(state: Array, costate: Array) -> tuple[Array, Array]:
    """Return q . e and q . e', the sensitivities of H to thrust and, per thrust, to tilt [s^2/m], shape (...) each."""
    sin, cos = np.sin(state[..., 4]), np.cos(state[..., 4])
    q_x, q_z = costate[..., 2], costate[..., 3]
    return q_x * sin + q_z * cos, q_x * cos - q_z * sin


def signs_agree(state: Array, control: Array, costate: Array, quadrotor: Quadrotor) -> Flags:
    """Return where thrust, and the rate if it is at a limit, maximise H, shape (...).

    A thrust between its bounds never agrees, because thrust has no singular arcs.
    """
    slack = AT_BOUND * (quadrotor.thrust_max - quadrotor.thrust_min)
    thrust, lift, p = control[..., 0], switching_functions(state, costate)[0], costate[..., 4]
    above = (thrust >= quadrotor.thrust_max - slack) & (lift >= -SIGN_TOLERANCE)
    below = (thrust <= quadrotor.thrust_min + slack) & (lift <= SIGN_TOLERANCE)
    turning = inner_rates(control, quadrotor) | (np.sign(control[..., 1]) * p >= -SIGN_TOLERANCE)
    return (above | below) & turning


def misalignment(state: Array, costate: Array) -> Array:
    """Return the angle from the tilt to q, modulo pi, in [-pi/2, pi/2] [rad], shape (...)."""
    along, across = switching_functions(state, costate)
    return np.arctan2(across * np.sign(along), np.abs(along))


def report(shot: ShootingSolution, scenario: Scenario) -> CostateReport:
    """Evaluate Pontryagin's conditions on a direct solution, from its multipliers.

    Hoops, floor and ceiling make the costates of position and velocity jump between steps only. The same three
    conditions therefore apply to scenarios with them.

    Args:
        shot: the result of `optimal.direct.shooting.solve_winding` for the scenario.
        scenario: the task.

    Raises:
        ValueError: unless there is one multiplier (5,) for each step.
    """
    flight, quadrotor = shot.trajectory, scenario.quadrotor
    if shot.costates.shape != (len(flight.controls), 5):
        raise ValueError(f"the report needs costates of shape ({len(flight.controls)}, 5), got {shot.costates.shape}")
    if not shot.converged:
        return CostateReport()
    steps = hamiltonian(flight.states[1:], flight.controls, shot.costates, quadrotor)
    h, share = np.diff(flight.breakpoints)[:, None], (np.arange(POINTS) + 0.5) / POINTS
    control = np.repeat(flight.controls[:, None], POINTS, axis=1)
    state = quadrotor.step(flight.states[:-1, None], control, h * share)
    costate = inner_costates(state, control, shot.costates[:, None], steps[:, None], h * (1 - share), quadrotor)
    time = np.broadcast_to(h / POINTS, control.shape[:-1])
    inner = inner_rates(flight.controls, quadrotor)
    # The first and last step of a singular arc, and a single step between two limits, contain a switch.
    inner[1:-1] &= inner[:-2] & inner[2:]
    # The tilt oscillates about q from step to step with decaying amplitude. Its mean over a step is along q.
    angle = misalignment(state, costate).mean(axis=1)[inner]
    return CostateReport(
        hamiltonian_drift=float(np.ptp(steps) / abs(steps.mean())),
        switching_agreement=float((time * signs_agree(state, control, costate, quadrotor)).sum() / time.sum()),
        singular_residual=float(np.sqrt(np.mean(angle**2))) if angle.size else 0.0,
    )


def inner_costates(state: Array, control: Array, last: Array, steps: Array, left: Array, quadrotor: Quadrotor) -> Array:
    """Return the costates inside steps, shape (N, POINTS, 5). The costate of the tilt is set to zero where the rate is.

    Args:
        state, control: states and controls inside the steps, shapes (N, POINTS, 5) and (N, POINTS, 2).
        last: costates at the ends of the steps, shape (N, 1, 5).
        steps: the Hamiltonian of each step, which determines p omega, shape (N, 1).
        left: time to the ends of the steps [s], shape (N, POINTS).
    """
    costate = np.repeat(last, POINTS, axis=1)
    costate[..., 2:4] += last[..., 0:2] * left[..., None]
    costate[..., 4] = 0.0
    rest = steps - hamiltonian(state, control, costate, quadrotor)
    rate = control[..., 1]
    costate[..., 4] = np.divide(rest, rate, out=np.zeros_like(rest), where=rate != 0)
    return costate
