"""What the costates say of a flight: is its Hamiltonian constant, do its controls follow the switching functions?

With costates (r, q, p) of position, velocity and tilt, e = (sin theta, cos theta) and e' = (cos theta, -sin theta),

    H = r . v + q . (f e - g e_z) + p omega,

a fastest flight has H = 1 all along and at every instant the controls that make H greatest: thrust_max where q . e > 0,
thrust_min where q . e < 0, the rate at its limit by the sign of p, and where it is not, the tilt along q.

The multipliers of a direct solution are costates without further error: its step is the exact flow under held controls,
so the multiplier of step k is the costate at the end of that step, and inside it q is linear in time and H constant.
What H changes from step to step, and the signs missed, are therefore the price of holding the controls over a step, and
vanish with it: controls that switch inside a step cost H the first order of its length.
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
"""A control this near to its bound, relative to the width of its range, is at it: an interior point
method only comes near a bound whose multiplier is small, as at the ends of singular arcs."""
SIGN = 1e-8
"""A switching function this near to zero has no sign [s and s^2/m]."""
POINTS = 8
"""Instants of a step at which signs and angles are looked at."""

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class CostateReport:
    """How well a direct solution keeps Pontryagin's conditions; inf (agreement: 0) where it did not converge.

    Attributes:
        hamiltonian_drift: greatest less least Hamiltonian over the steps, divided by the mean.
        switching_agreement: share of the time at which thrust stands at the bound that the sign of q . e
            asks for, and the rate, where it stands at a bound, at the one that the sign of p asks for.
        singular_residual: angle from the tilt to q, modulo pi, averaged over each step, root of the mean square over
            the steps whose rate stands at no bound, nor do their neighbours' [rad]; 0 where there is none.
    """

    hamiltonian_drift: float = math.inf
    switching_agreement: float = 0.0
    singular_residual: float = math.inf


def hamiltonian(state: Array, control: Array, costate: Array, quadrotor: Quadrotor) -> Array:
    """Return H of states (..., 5), controls (..., 2) and costates (..., 5), shape (...)."""
    return np.sum(costate * quadrotor.derivative(state, control), axis=-1)


def inner_rates(control: Array, quadrotor: Quadrotor) -> Flags:
    """Return where the rate of controls (..., 2) stands at neither limit, shape (...)."""
    return np.abs(control[..., 1]) < quadrotor.rate_max * (1 - 2 * AT_BOUND)


def switching_functions(state: Array, costate: Array) -> tuple[Array, Array]:
    """Return q . e and q . e', the sensitivities of H to thrust and, per thrust, to tilt [s^2/m], shape (...)."""
    sin, cos = np.sin(state[..., 4]), np.cos(state[..., 4])
    q_x, q_z = costate[..., 2], costate[..., 3]
    return q_x * sin + q_z * cos, q_x * cos - q_z * sin


def signs_agree(state: Array, control: Array, costate: Array, quadrotor: Quadrotor) -> Flags:
    """Return where thrust, and the rate unless it is an inner one, stand where H is greatest, shape (...).

    A thrust between its bounds never does: it has no singular arcs.
    """
    slack = AT_BOUND * (quadrotor.thrust_max - quadrotor.thrust_min)
    thrust, lift, p = control[..., 0], switching_functions(state, costate)[0], costate[..., 4]
    above = (thrust >= quadrotor.thrust_max - slack) & (lift >= -SIGN)
    below = (thrust <= quadrotor.thrust_min + slack) & (lift <= SIGN)
    turning = inner_rates(control, quadrotor) | (np.sign(control[..., 1]) * p >= -SIGN)
    return (above | below) & turning


def misalignment(state: Array, costate: Array) -> Array:
    """Return the angle from the tilt to q, modulo pi, in [-pi/2, pi/2] [rad], shape (...)."""
    along, across = switching_functions(state, costate)
    return np.arctan2(across * np.sign(along), np.abs(along))


def report(shot: ShootingSolution, scenario: Scenario) -> CostateReport:
    """Hold a direct solution against Pontryagin's conditions, by its multipliers.

    Hoops, floors and ceilings only make the costates of position and velocity jump between steps, so
    that the same three conditions stand with them.

    Args:
        shot: what `optimal.direct.shooting.solve_winding` returned for the scenario.
        scenario: what was to be flown.

    Raises:
        ValueError: when there is not one multiplier (5,) for each step.
    """
    flight, quadrotor = shot.trajectory, scenario.quadrotor
    if shot.costates.shape != (len(flight.controls), 5):
        raise ValueError(f"needs costates of shape ({len(flight.controls)}, 5), got {shot.costates.shape}")
    if not shot.converged:
        return CostateReport()
    steps = hamiltonian(flight.states[1:], flight.controls, shot.costates, quadrotor)
    h, share = np.diff(flight.breakpoints)[:, None], (np.arange(POINTS) + 0.5) / POINTS
    control = np.repeat(flight.controls[:, None], POINTS, axis=1)
    state = quadrotor.step(flight.states[:-1, None], control, h * share)
    costate = inner_costates(state, control, shot.costates[:, None], steps[:, None], h * (1 - share), quadrotor)
    time = np.broadcast_to(h / POINTS, control.shape[:-1])
    inner = inner_rates(flight.controls, quadrotor)
    # The first and last step of a singular arc are partly of its neighbours, as is a lone step between two limits.
    inner[1:-1] &= inner[:-2] & inner[2:]
    # The tilt zigzags about q there, a step to each side, and dies away; the mean over a step is q's.
    angle = misalignment(state, costate).mean(axis=1)[inner]
    return CostateReport(
        hamiltonian_drift=float(np.ptp(steps) / abs(steps.mean())),
        switching_agreement=float((time * signs_agree(state, control, costate, quadrotor)).sum() / time.sum()),
        singular_residual=float(np.sqrt(np.mean(angle**2))) if angle.size else 0.0,
    )


def inner_costates(state: Array, control: Array, last: Array, steps: Array, left: Array, quadrotor: Quadrotor) -> Array:
    """Return the costates inside steps, shape (N, POINTS, 5), that of tilt zero where the rate is.

    Args:
        state, control: inside the steps, shapes (N, POINTS, 5) and (N, POINTS, 2).
        last: costates at the ends of the steps, shape (N, 1, 5).
        steps: the Hamiltonian of each step, which p omega makes up to, shape (N, 1).
        left: time to the ends of the steps [s], shape (N, POINTS).
    """
    costate = np.repeat(last, POINTS, axis=1)
    costate[..., 2:4] += last[..., 0:2] * left[..., None]
    costate[..., 4] = 0.0
    rest = steps - hamiltonian(state, control, costate, quadrotor)
    rate = control[..., 1]
    costate[..., 4] = np.divide(rest, rate, out=np.zeros_like(rest), where=rate != 0)
    return costate
