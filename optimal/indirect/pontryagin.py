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

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import root

from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenarios.scenario import Scenario
from optimal.direct.shooting import WINDINGS, solve_winding
from optimal.indirect.arcs import ArcControl, arcs_of, sequence
from optimal.indirect.conditions import conditions, equations
from optimal.indirect.costates import SIGN, hamiltonian, misalignment, signs_agree, switching_functions
from optimal.indirect.extremal import POINTS, Extremal, ExtremalFlight, along, control_arcs

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
        shot = solve_winding(scenario, winding, nodes=nodes)
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


def refine(scenario: Scenario, winding: int, modes: tuple[ArcControl, ...], guess: Array) -> Extremal:
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


def assemble(
    modes: tuple[ArcControl, ...], durations: Array, states: Array, line: Array, quadrotor: Quadrotor
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
    result: Extremal, flight: ExtremalFlight, modes: tuple[ArcControl, ...], durations: Array
) -> tuple[Extremal, list[tuple[ArcControl, float]]]:
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
    lift, slip = switching_functions(state, costate)
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
