"""Extremals in closed form: bang and singular arcs, and the flight they form.

A bang arc holds thrust and rate; its flow is `flatgym.Quadrotor.step`. On a singular arc the tilt follows the velocity
costate q(t) = q0 + q1 t, theta = atan2(q_x, q_z), at thrust_max. The rate is then

    omega = (q1_x q0_z - q1_z q0_x) / |q|^2,

and position and velocity are elementary integrals (`singular_step`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flatgym.quadrotor import Array
from optimal.flights.replay import fine_grid
from optimal.flights.trajectory import Trajectory
from optimal.indirect.arcs import ArcControl
from optimal.indirect.costates import hamiltonian, switching_functions

POINTS = 8
"""Instants between two breakpoints at which controls are compared with the switching functions."""


@dataclass(frozen=True)
class ControlArc:
    """One arc of an extremal.

    Attributes:
        start, end: times [s].
        thrust: mass-normalised thrust [m/s^2].
        rate: "max", "min" or "singular".
    """

    start: float
    end: float
    thrust: float
    rate: str


@dataclass(frozen=True)
class ExtremalFlight(Trajectory):
    """A flight of bang and singular arcs, in closed form at every instant.

    Attributes:
        breakpoints, states, quadrotor: as in `Trajectory`; a breakpoint need not be a switch.
        controls: thrust and rate from each breakpoint to the next, shape (N, 2); the rate is NaN on singular arcs.
        q0, q1: velocity costate at the start and its slope [s^2/m, s/m], shape (2,) each.
    """

    q0: Array
    q1: Array

    def state(self, t: ArrayLike) -> Array:
        """Return [x, z, vx, vz, theta] at times t, shape (..., 5)."""
        time, arc = self._arc(t)
        start, controls, elapsed = self.states[arc], self.controls[arc], time - self.breakpoints[arc]
        state, singular = self.quadrotor.step(start, np.nan_to_num(controls), elapsed), np.isnan(controls[..., 1])
        q = self.costate(self.breakpoints[arc])[..., 2:4]
        followed = singular_step(
            start[singular].T,
            controls[singular].T[0],
            q[singular].T,
            self.q1,
            elapsed[singular],
            self.quadrotor.gravity,
        )
        state[singular] = np.stack(followed, axis=-1)
        return state

    def control(self, t: ArrayLike) -> Array:
        """Return [thrust, rate] at times t, shape (..., 2)."""
        time, arc = self._arc(t)
        control, q = self.controls[arc], self.costate(time)[..., 2:4]
        following = (self.q1[0] * self.q0[1] - self.q1[1] * self.q0[0]) / (q**2).sum(axis=-1)
        rate = np.where(np.isnan(control[..., 1]), following, control[..., 1])
        return np.stack([control[..., 0], rate], axis=-1)

    def control_range(self) -> Array:
        """Return least and greatest [thrust, rate], shape (2, 2).

        The rate of a singular arc is c/|q|^2 with q linear in time. It is greatest where |q| is least.
        """
        q = self.costate(self.breakpoints)[:, 2:4]
        begin, along = q[:-1], np.diff(q, axis=0)
        share = np.clip(-(begin * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300), 0, 1)
        least = ((begin + share[:, None] * along) ** 2).sum(axis=1)
        with np.errstate(divide="ignore"):
            rate = abs(self.q1[0] * self.q0[1] - self.q1[1] * self.q0[0]) / least
        thrust, held = self.controls.T
        rate = float(np.where(np.isnan(held), rate, np.abs(held)).max())
        return np.array([[thrust.min(), -rate], [thrust.max(), rate]])

    def costate(self, t: ArrayLike, p: ArrayLike = 0.0) -> Array:
        """Return the costates of position, velocity and tilt at times t, shape (..., 5); p is that of the tilt."""
        time, p = np.broadcast_arrays(np.asarray(t, dtype=np.float64), p)
        q = self.q0 + self.q1 * time[..., None]
        return np.concatenate([np.broadcast_to(-self.q1, q.shape), q, p[..., None]], axis=-1)


@dataclass(frozen=True)
class Extremal:
    """A flight that satisfies Pontryagin's conditions, or the state of the last attempt.

    Attributes:
        winding: whole turns of the tilt.
        message: the outcome and what to do about it, a sentence.
        time: flight time from rest to rest [s]; inf unless converged.
        converged: whether the equations are solved, no arc has negative duration, and all signs agree.
        q0, q1: velocity costate at the start and its slope [s^2/m, s/m], shape (2,) each. The position costate is -q1.
        switches: the arcs in order of time.
        residual: largest residual of the equations [m, m/s, rad; dimensionless for the switching conditions].
        sign_agreement: share of the flight time at which all controls agree with the switching functions.
        hamiltonian_drift: range of H along the flight, with p integrated. H should be 1.
        evaluations: evaluations of the equations, after the direct solution.
        trajectory: the flight; None unless converged.
        direct_time: time of the direct solution whose structure was solved [s], that of a flight; inf without one.
    """

    winding: int
    message: str
    time: float = math.inf
    converged: bool = False
    q0: Array = field(default_factory=lambda: np.full(2, np.nan))
    q1: Array = field(default_factory=lambda: np.full(2, np.nan))
    switches: tuple[ControlArc, ...] = ()
    residual: float = math.inf
    sign_agreement: float = 0.0
    hamiltonian_drift: float = math.inf
    evaluations: int = 0
    trajectory: ExtremalFlight | None = None
    direct_time: float = math.inf


def singular_step(state: Any, thrust: Any, q: Any, q1: Any, h: Any, gravity: Any, ops: Any = np) -> tuple[Any, ...]:
    """Return the five components of the state after h seconds on a singular arc, where the tilt follows q + q1 t.

    In the directions along and across q1, q / |q| = (sinh w, 1) / cosh w with sinh w = q . q1 / |q x q1|, and
    dt = tau cosh w dw. In terms of w all integrals are elementary.

    Args:
        state, q, q1: sequences of components, which are arrays or symbols.
        thrust: mass-normalised thrust [m/s^2].
        h: duration [s].
        gravity: gravitational acceleration [m/s^2].
        ops: numpy or casadi.
    """
    x, z, vx, vz, theta = state
    cross, size, norm = q1[0] * q[1] - q1[1] * q[0], q1[0] ** 2 + q1[1] ** 2, ops.sqrt(q1[0] ** 2 + q1[1] ** 2)
    side = cross / ops.fabs(cross)
    along, across, tau = (q1[0] / norm, q1[1] / norm), (-side * q1[1] / norm, side * q1[0] / norm), side * cross / size
    sinh = (q[0] * q1[0] + q[1] * q1[1]) / (side * cross)
    sinh_end = sinh + h / tau
    cosh, cosh_end = ops.sqrt(1 + sinh**2), ops.sqrt(1 + sinh_end**2)
    dw = ops.asinh(sinh_end) - ops.asinh(sinh)
    v_along, v_across = thrust * tau * (cosh_end - cosh), thrust * tau * dw
    p_along = thrust * tau**2 * ((dw + sinh_end * cosh_end + sinh * cosh) / 2 - cosh * sinh_end)
    p_across = thrust * tau**2 * (dw * sinh_end - cosh_end + cosh)
    return (
        x + vx * h + along[0] * p_along + across[0] * p_across,
        z + vz * h + along[1] * p_along + across[1] * p_across - gravity * h * h / 2,
        vx + along[0] * v_along + across[0] * v_across,
        vz + along[1] * v_along + across[1] * v_across - gravity * h,
        theta + side * (ops.atan(sinh_end) - ops.atan(sinh)),
    )


def costate_samples(flight: ExtremalFlight) -> tuple[Array, Array, Array, Array]:
    """Return durations [s], states, controls and costates (n, 5) at the middles of POINTS parts of each piece.

    H = 1 gives p at the start. From there p is integrated by Gauss-Legendre quadrature.
    """
    time = fine_grid(flight.breakpoints, np.full(len(flight.breakpoints) - 1, 2 * POINTS))
    nodes, weights = np.polynomial.legendre.leggauss(3)
    inside = time[:-1, None] + np.diff(time)[:, None] * (nodes + 1) / 2
    slopes = -flight.control(inside)[..., 0] * switching_functions(flight.state(inside), flight.costate(inside))[1]
    control = flight.control(0.0)
    start = (1 - hamiltonian(flight.state(0.0), control, flight.costate(0.0), flight.quadrotor)) / control[1]
    p = start + np.append(0.0, np.cumsum(np.diff(time) * (slopes @ weights) / 2))
    middle = time[1::2]
    return np.diff(time[::2]), flight.state(middle), flight.control(middle), flight.costate(middle, p[1::2])


def control_arcs(structure: tuple[ArcControl, ...], durations: Array) -> tuple[ControlArc, ...]:
    """Return the arcs of a structure with their times [s] and the names of their rates."""
    ends = np.append(0.0, np.cumsum(durations)).tolist()
    names = ["singular" if rate is None else "max" if rate > 0 else "min" for _, rate in structure]
    return tuple(map(ControlArc, ends[:-1], ends[1:], [thrust for thrust, _ in structure], names))
