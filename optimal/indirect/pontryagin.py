"""The indirect method of the paper's reference [8]: Pontryagin's minimum principle for flights in free space.

With q = (q_x, q_z) the costate of velocity, p the costate of the tilt, e = (sin theta, cos theta) and
e' = (cos theta, -sin theta), a time-optimal flight maximises the Hamiltonian at every instant, and its value is one:

    H = -q1 . v + q . (f e - g e_z) + p omega = 1,    q(t) = q0 + q1 t,    p' = -f q . e'.

Thrust is bang-bang, by the sign of q . e. The rate is bang-singular, by the sign of p. On a singular arc p and q . e'
are zero, and the tilt follows q, theta = atan2(q_x, q_z), at thrust_max. H = 1 gives p without an integration:

    p omega = 1 + q1 . v - q . (f e - g e_z).

The unknowns are the durations of the arcs, q0 and q1. The equations are five end conditions; q . e = 0 where thrust
switches; p = 0 where the rate switches; and q . e' = 0 where a singular arc begins. At the end of a singular arc p and
q . e' are zero already. Unknowns and equations are equal in number. Every arc is a closed form, and a quasi-Newton
method solves the equations to rounding.

The structure, and the first guess of the unknowns, are read from the steps and multipliers of a direct solution. The
result does not depend on it: its controls are verified against the signs of the switching functions, with p integrated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import root

from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenarios.scenario import Scenario
from optimal.direct.shooting import WINDINGS, solve_winding
from optimal.indirect.arcs import ArcControl, arcs_of, merged_arcs
from optimal.indirect.conditions import conditions, equations
from optimal.indirect.extremal import Extremal, ExtremalFlight
from optimal.indirect.verification import verify

NODES = (100, 200)
"""Steps of the direct solutions whose structures are tried, in this order."""
ASIDE = 1e-3
"""Displacement of the goal of the direct solution tried last [m]. Straight above the start or below it, a direct
solution may stop at the straight flight, of which neither side is better to first order, though both are faster."""
MAX_STRUCTURES = 6
"""Most structures tried from one direct solution."""
LEAST_DURATION = 2e-5
"""An inner arc up to this long is removed [s]. A bang arc within a singular arc solves the equations with length 0."""
RESIDUAL_TOLERANCE = 1e-10
"""Largest residual of a solution [m, m/s, rad; dimensionless for the switching conditions]."""
MAX_TURN = 0.2
"""Largest turn of the tilt between two breakpoints of a flight [rad]."""


def pontryagin(scenario: Scenario, winding: int = 0) -> Extremal:
    """Solve Pontryagin's conditions for a flight in free space with a given winding.

    Args:
        scenario: the task, from exact rest to exact rest.
        winding: whole turns of the tilt between start and goal, positive towards +x.

    Returns:
        The extremal. If no structure converges, its time is inf and its message gives the reason.

    Raises:
        ValueError: for a scenario with hoops, a floor or a ceiling, where the costates jump, or a winding that is not
            a whole number.
    """
    if not isinstance(winding, (int, np.integer)):
        raise ValueError(f"winding must be a whole number of turns, got {winding!r}")
    for name, limit in (("hoops", scenario.hoops), ("floor", scenario.floor), ("ceiling", scenario.ceiling)):
        if limit not in ((), None):
            raise ValueError(
                f"Scenario.{name} of {scenario.name!r} must be empty for Pontryagin's conditions in free space, got "
                f'{limit!r}; use method="shooting", or remove it'
            )
    result = Extremal(winding, "Not solved: no direct solution of this winding converged; try another winding.")
    direct_time = result.direct_time
    x, z = scenario.goal
    beside = replace(scenario, goal=(x + ASIDE, z))
    for nodes, flown in ((NODES[0], scenario), (NODES[1], scenario), (NODES[0], beside)):
        shot = solve_winding(flown, winding, nodes=nodes)
        if shot.converged:
            result = solve_structure(scenario, winding, *arcs_of(shot))
            direct_time = direct_time if flown is beside else shot.trajectory.duration
        if result.converged:
            break
    return replace(result, direct_time=direct_time)


def fastest(scenario: Scenario, windings: Sequence[int] = WINDINGS) -> Extremal:
    """Return the fastest of the extremals of several windings, or the first attempt if none converged.

    Raises:
        ValueError: for no windings, or as in `pontryagin`.
    """
    if not windings:
        raise ValueError(f"needs at least one winding, got windings={windings!r}")
    return min((pontryagin(scenario, winding) for winding in windings), key=lambda extremal: extremal.time)


def solve_structure(scenario: Scenario, winding: int, structure: tuple[ArcControl, ...], guess: Array) -> Extremal:
    """Solve the conditions of a switching structure, and correct the structure until all signs agree.

    An arc of negative duration is removed. Where a control disagrees with its switching function, an arc with the
    suggested control is inserted. The correction stops after MAX_STRUCTURES structures.

    Args:
        scenario, winding: the task.
        structure: thrust and rate of the n arcs.
        guess: approximate durations [s], q0 and q1, shape (n + 4,).
    """
    end = scenario.goal_state - scenario.start_state + 2 * np.pi * winding * np.eye(5)[4]
    result = Extremal(winding, "Not solved: no structure found satisfies all conditions; try another winding.")
    for _ in range(MAX_STRUCTURES):
        system, count = conditions(structure, scenario.quadrotor.gravity), len(structure)
        if system.size1_out(0) != len(guess):  # a singular arc at an end has no equations
            break
        solution = root(equations, guess, args=(system, end), jac=True, options={"xtol": 1e-14})
        durations, line, residual = solution.x[:count], solution.x[count:], float(np.abs(solution.fun).max())
        lasting = durations > np.array([0.0, *[LEAST_DURATION] * (count - 2), 0.0])[-count:]
        result = replace(
            result, evaluations=result.evaluations + solution.nfev, residual=residual, q0=line[:2], q1=line[2:]
        )
        if not (residual <= RESIDUAL_TOLERANCE and lasting.any()):
            break
        if lasting.all():
            states = np.array(system(solution.x, end)[2]).T + scenario.start_state
            flight = assemble(structure, durations, states, line, scenario.quadrotor)
            result, pieces = verify(result, flight, structure, durations)
            if result.converged:
                break
        else:
            pieces = [(structure[i], guess[i]) for i in range(count) if lasting[i]]
            line = guess[count:]
        structure, lengths = merged_arcs(pieces)
        guess = np.append(lengths, line)
    return result


def assemble(
    structure: tuple[ArcControl, ...], durations: Array, states: Array, line: Array, quadrotor: Quadrotor
) -> ExtremalFlight:
    """Return the flight of solved arcs, divided into pieces over which the tilt turns by at most MAX_TURN.

    Args:
        structure, durations: controls and durations [s] of the n arcs.
        states: states at the n + 1 junctions, shape (n + 1, 5).
        line: q0 and q1, shape (4,).
        quadrotor: the vehicle.
    """
    controls = np.array([[thrust, np.nan if rate is None else rate] for thrust, rate in structure])
    ends = np.append(0.0, np.cumsum(durations))
    flight = ExtremalFlight(ends, states, controls, quadrotor, line[:2], line[2:])
    cuts = np.ceil(durations * quadrotor.rate_max / MAX_TURN).astype(int)
    inner = [np.linspace(ends[i], ends[i + 1], n, endpoint=False) for i, n in enumerate(cuts)]
    time = np.append(np.concatenate(inner), ends[-1])
    return replace(flight, breakpoints=time, states=flight.state(time), controls=np.repeat(controls, cuts, axis=0))
