"""The indirect road, the paper's reference [8]: Pontryagin's minimum principle for flights in free space.

With q = (q_x, q_z) the costate of velocity, p that of tilt, e = (sin theta, cos theta) and
e' = (cos theta, -sin theta), a fastest flight makes the Hamiltonian greatest at every instant, and keeps it at one:

    H = -q1 . v + q . (f e - g e_z) + p omega = 1,    q(t) = q0 + q1 t,    p' = -f q . e'.

So thrust is bang-bang by the sign of q . e, and the rate bang-singular by that of p: where p stays zero so does
q . e', and the tilt follows q, theta = atan2(q_x, q_z), at thrust_max. H = 1 gives p without an integration,

    p omega = 1 + q1 . v - q . (f e - g e_z).

Unknown are the durations of the arcs, q0 and q1, and as many equations hold: five at the goal; q . e = 0 where thrust
switches; p = 0 where the rate does, and q . e' = 0 as well where a singular arc begins (where one ends both hold
already). Every arc is a closed form, and a quasi-Newton method solves the equations to rounding. Which arcs follow
one another is read off the steps of a direct solution, whose multipliers are the first guess of q. What comes out owes
nothing to it: its controls are held against the signs of the switching functions, with p integrated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import root

from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenario import Scenario
from optimal.certificate import fine_grid
from optimal.costates import SIGN, Mode, arcs_of, hamiltonian, lifts, misalignment, sequence, signs_agree
from optimal.shooting import WINDINGS, shoot
from optimal.trajectory import Trajectory
from optimal.transcription import step_function

NODES = (100, 200)
"""Steps of the direct solutions whose arcs are tried, one after the other."""
SEQUENCES = 6
"""Most sequences of arcs tried from one direct solution."""
SHORTEST = 2e-5
"""Inner arcs no longer than this are none [s]: a bang arc inside a singular one solves the equations by vanishing."""
SOLVED = 1e-10
"""Largest residual of a solution [m, m/s, rad; the switching conditions are measured without a unit]."""
TURN = 0.2
"""Most that the tilt turns between two breakpoints of a flight [rad]."""
POINTS = 8
"""Instants between two breakpoints at which controls are held against the switching functions."""


@dataclass(frozen=True)
class ControlArc:
    """One arc: `start` and `end` [s], its `thrust` [m/s^2], and its rate, "max", "min" or "singular"."""

    start: float
    end: float
    thrust: float
    rate: str


@dataclass(frozen=True)
class ExtremalFlight(Trajectory):
    """A flight of bang and singular arcs, exact at every instant.

    Attributes:
        breakpoints, states, quadrotor: as of a Trajectory; a breakpoint need not be a switch.
        controls: thrust and rate from each breakpoint on, the rate NaN on singular arcs, shape (N, 2).
        q0, q1: velocity costate at the start and its slope [s^2/m, s/m], shape (2,).
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
        """Return bounds of [thrust, rate], least and greatest, shape (2, 2).

        The rate of a singular arc, c/|q|^2 with q linear in time, is greatest where |q| is least.
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
        """Return the costates of position, velocity and, as given, tilt at times t, shape (..., 5)."""
        time, p = np.broadcast_arrays(np.asarray(t, dtype=np.float64), p)
        q = self.q0 + self.q1 * time[..., None]
        return np.concatenate([np.broadcast_to(-self.q1, q.shape), q, p[..., None]], axis=-1)


@dataclass(frozen=True)
class Extremal:
    """A flight that keeps Pontryagin's conditions, or how far the last attempt at one came.

    Attributes:
        winding: whole turns made.
        message: what came out and what to do about it, a sentence.
        time: from rest to rest [s]; inf unless converged.
        converged: whether the equations are solved, no arc runs backwards, and controls and signs agree throughout.
        q0, q1: velocity costate at the start and its slope, the position costate being -q1 [s^2/m, s/m], shape (2,).
        switches: the arcs in order of time.
        residual: largest of all equations [m, m/s, rad; 1 for the switching conditions].
        sign_agreement: share of the time over which all controls are those the switching functions ask for.
        hamiltonian_drift: greatest less least H along the flight, where it should be one, with p integrated.
        evaluations: of the equations, since the direct solution.
        trajectory: the flight; None unless converged.
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


def singular_step(state: Any, thrust: Any, q: Any, q1: Any, h: Any, gravity: Any, ops: Any = np) -> tuple[Any, ...]:
    """Return the five components of the state after h seconds in which the tilt follows q + q1 t.

    Measured along q1 and across it, q / |q| = (sinh w, 1) / cosh w with sinh w = q . q1 / |q x q1|, and
    dt = tau cosh w dw: in w all integrals are elementary. `state`, `q` and `q1` are sequences of
    components, arrays or symbols; `ops` is numpy or casadi.
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


@lru_cache(maxsize=256)
def conditions(modes: tuple[Mode, ...], gravity: float) -> Any:
    """Return the equations of a sequence of n arcs, as a CasADi function.

    Its arguments are the unknowns, durations (n,), q0 (2,) and q1 (2,), and the end state less the start's (5,);
    its results the residuals (n+4,), their Jacobian (n+4, n+4), and the states at all breakpoints (5, n+1).
    """
    count = len(modes)
    unknowns, end = ca.SX.sym("unknowns", count + 4), ca.SX.sym("end", 5)
    q, q1, states, zero = unknowns[count : count + 2], unknowns[count + 2 :], [ca.SX.zeros(5)], []
    for i, (thrust, rate) in enumerate(modes):
        if i:
            zero += switching(modes[i - 1], modes[i], states[-1], q, q1, gravity)
        h = unknowns[i]
        if rate is None:
            split = (ca.vertsplit(states[-1]), thrust, ca.vertsplit(q), ca.vertsplit(q1))
            states.append(ca.vertcat(*singular_step(*split, h, gravity, ca)))
        else:
            states.append(step_function()(states[-1], ca.vertcat(thrust, rate), h, gravity))
        q += q1 * h
    residuals = ca.vertcat(states[-1] - end, *zero)
    results = [residuals, ca.jacobian(residuals, unknowns), ca.horzcat(*states)]
    return ca.Function("conditions", [unknowns, end], results)


def switching(before: Mode, after: Mode, state: Any, q: Any, q1: Any, gravity: float) -> list[Any]:
    """Return what must vanish where one arc gives way to another."""
    sin, cos, norm = ca.sin(state[4]), ca.cos(state[4]), ca.norm_2(q)
    along, across, zero = q[0] * sin + q[1] * cos, q[0] * cos - q[1] * sin, []
    if before[0] != after[0]:
        zero.append(along / norm)
    if before[1] != after[1] and before[1] is not None:
        zero.append(1 + ca.dot(q1, state[2:4]) - before[0] * along + q[1] * gravity)
    if before[1] != after[1] and after[1] is None:
        zero.append(across / norm)
    return zero


def pontryagin(scenario: Scenario, winding: int = 0) -> Extremal:
    """Solve Pontryagin's conditions for a flight in free space with a given number of turns.

    Args:
        scenario: what to fly, from exact rest to exact rest.
        winding: whole turns of the tilt between start and goal, positive towards +x.

    Raises:
        ValueError: for a scenario with hoops, a floor or a ceiling, where the costates would jump, or a
            winding that is not a whole number.
    """
    if not isinstance(winding, (int, np.integer)):
        raise ValueError(f"winding must be a whole number of turns, got {winding!r}")
    for name, limit in (("hoops", scenario.hoops), ("floor", scenario.floor), ("ceiling", scenario.ceiling)):
        if limit not in ((), None):
            raise ValueError(
                f"Scenario.{name} of {scenario.name!r} must be empty for Pontryagin's conditions in free space, got "
                f'{limit!r}; use method="shooting", or drop it'
            )
    result = Extremal(winding, "Not solved: no direct solution of this winding converged to begin from; try another.")
    for nodes in NODES:
        shot = shoot(scenario, winding, nodes=nodes)
        if shot.converged:
            result = refine(scenario, winding, *arcs_of(shot))
        if result.converged:
            break
    return result


def fastest(scenario: Scenario, windings: Sequence[int] = WINDINGS) -> Extremal:
    """Return the fastest of the extremals of several windings, or the first attempt where none converged.

    Raises:
        ValueError: when there is no winding to try, or as `pontryagin` does.
    """
    if not windings:
        raise ValueError(f"needs at least one winding, got windings={windings!r}")
    return min((pontryagin(scenario, winding) for winding in windings), key=lambda extremal: extremal.time)


def refine(scenario: Scenario, winding: int, modes: tuple[Mode, ...], guess: Array) -> Extremal:
    """Solve the conditions of a sequence of arcs, and of others if its solution asks for them.

    An arc that comes out backwards is left out, and where a control is against its switching function an
    arc that follows it is put in, until all agree or SEQUENCES were tried.

    Args:
        scenario, winding: what to fly.
        modes: thrust and rate of the n arcs.
        guess: their durations [s], q0 and q1, about, shape (n + 4,).
    """
    end = scenario.goal_state - scenario.start_state + 2 * np.pi * winding * np.eye(5)[4]
    result = Extremal(winding, "Not solved: no sequence of arcs found keeps all conditions; try another winding.")
    for _ in range(SEQUENCES):
        system, count = conditions(modes, scenario.quadrotor.gravity), len(modes)
        if system.size1_out(0) != len(guess):  # no equations for a singular arc at an end
            break
        found = root(equations, guess, args=(system, end), jac=True, options={"xtol": 1e-14})
        durations, line, residual = found.x[:count], found.x[count:], float(np.abs(found.fun).max())
        lasting = durations > np.array([0.0, *[SHORTEST] * (count - 2), 0.0])[-count:]
        result = replace(
            result, evaluations=result.evaluations + found.nfev, residual=residual, q0=line[:2], q1=line[2:]
        )
        if not (residual <= SOLVED and lasting.any()):
            break
        if lasting.all():
            states = np.array(system(found.x, end)[2]).T + scenario.start_state
            flight = assemble(modes, durations, states, line, scenario.quadrotor)
            result, pieces = judge(result, flight, modes, durations)
            if result.converged:
                break
        else:
            pieces = [(modes[i], guess[i]) for i in range(count) if lasting[i]]
            line = guess[count:]
        modes, lengths = sequence(pieces)
        guess = np.append(lengths, line)
    return result


def equations(unknowns: Array, system: Any, end: Array) -> tuple[Array, Array]:
    """Return residuals and Jacobian of the conditions as NumPy arrays."""
    residuals, jacobian, _ = system(unknowns, end)
    return np.array(residuals).ravel(), np.array(jacobian)


def assemble(
    modes: tuple[Mode, ...], durations: Array, states: Array, line: Array, quadrotor: Quadrotor
) -> ExtremalFlight:
    """Return the flight of solved arcs, cut into pieces over which the tilt turns little."""
    controls = np.array([[thrust, np.nan if rate is None else rate] for thrust, rate in modes])
    ends = np.append(0.0, np.cumsum(durations))
    flight = ExtremalFlight(ends, states, controls, quadrotor, line[:2], line[2:])
    cuts = np.ceil(durations * quadrotor.rate_max / TURN).astype(int)
    inner = [np.linspace(ends[i], ends[i + 1], n, endpoint=False) for i, n in enumerate(cuts)]
    time = np.append(np.concatenate(inner), ends[-1])
    return replace(flight, breakpoints=time, states=flight.state(time), controls=np.repeat(controls, cuts, axis=0))


def judge(
    result: Extremal, flight: ExtremalFlight, modes: tuple[Mode, ...], durations: Array
) -> tuple[Extremal, list[tuple[Mode, float]]]:
    """Hold the controls of a flight against the switching functions.

    Returns:
        The result, converged if they agree throughout, and pieces of flight with the controls that
        the switching functions ask for, with their lengths [s].
    """
    q, singular = flight.quadrotor, np.repeat(np.isnan(flight.controls[:, 1]), POINTS)
    width, state, control, costate = along(flight)
    p, rate = costate[:, 4], control[:, 1]
    followed = (np.abs(p) <= SIGN) & (np.abs(misalignment(state, costate)) <= SIGN) & (np.abs(rate) <= q.rate_max)
    agreed = signs_agree(state, control, costate, q) & (followed | ~singular)
    result = replace(
        result,
        switches=control_arcs(modes, durations),
        sign_agreement=1.0 if agreed.all() else float(width[agreed].sum() / width.sum()),
        hamiltonian_drift=float(np.ptp(hamiltonian(state, control, costate, q))),
    )
    if agreed.all():
        message = "Solved: Pontryagin's conditions hold, the signs of the switching functions included."
        result = replace(result, message=message, converged=True, time=flight.duration, trajectory=flight)
    lift, slip = lifts(state, costate)
    thrust = np.where(lift > 0, q.thrust_max, q.thrust_min)
    turning = np.where(singular, 0.0, np.sign(p))
    # Where q turns too fast to follow, by a parabola's excess, the tilt starts before it and ends after
    # it: sqrt(3) times as long as q is too fast, from twice the excess below the limit.
    if (peak := np.abs(rate[singular]).max(initial=0.0)) > q.rate_max:
        fast = singular & (np.abs(rate) > max(3 * q.rate_max - 2 * peak, q.rate_max / 2))
        turning[fast] = np.sign(rate[fast])
    # A p that has the wrong sign while the tilt passes q, or on both sides of a switch, wants to stay zero there.
    wrong = np.flatnonzero(turning * rate < 0)
    for run in np.split(wrong, np.flatnonzero(np.diff(wrong) > 1) + 1):
        lifted = run[lift[run] > 0]
        if len(set(np.sign(slip[lifted]))) > 1 or len(set(turning[lifted])) > 1:
            turning[lifted] = 0.0
    labels = zip(thrust.tolist(), (turning * q.rate_max).tolist(), strict=True)
    return result, [((f, turn or None), length) for (f, turn), length in zip(labels, width.tolist(), strict=True)]


def along(flight: ExtremalFlight) -> tuple[Array, Array, Array, Array]:
    """Return the middles of POINTS parts of each piece: widths [s], states, controls, and costates (n, 5).

    p begins as H = 1 has it and is integrated from there by Gauss-Legendre quadrature.
    """
    time = fine_grid(flight.breakpoints, np.full(len(flight.breakpoints) - 1, 2 * POINTS))
    nodes, weights = np.polynomial.legendre.leggauss(3)
    inside = time[:-1, None] + np.diff(time)[:, None] * (nodes + 1) / 2
    slopes = -flight.control(inside)[..., 0] * lifts(flight.state(inside), flight.costate(inside))[1]
    control = flight.control(0.0)
    start = (1 - hamiltonian(flight.state(0.0), control, flight.costate(0.0), flight.quadrotor)) / control[1]
    p = start + np.append(0.0, np.cumsum(np.diff(time) * (slopes @ weights) / 2))
    middle = time[1::2]
    return np.diff(time[::2]), flight.state(middle), flight.control(middle), flight.costate(middle, p[1::2])


def control_arcs(modes: tuple[Mode, ...], durations: Array) -> tuple[ControlArc, ...]:
    """Return the arcs with their times and names."""
    ends = np.append(0.0, np.cumsum(durations)).tolist()
    names = ["singular" if rate is None else "max" if rate > 0 else "min" for _, rate in modes]
    return tuple(map(ControlArc, ends[:-1], ends[1:], [thrust for thrust, _ in modes], names))
