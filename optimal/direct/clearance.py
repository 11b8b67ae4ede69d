"""Bodies with a radius: a flight that keeps clear of the rims in continuous time.

A point that crosses the middle of the gap may still touch a rim with its body before or after. So
the flight of the point comes first; then, starting from it, the distance to both rim points is
constrained at the quarter points of all arcs around the crossing,

    |p - rim|^2 >= (radius + clearance)^2.

Between the quarter points the body can still dip in, by half a millimetre or so: how deep is
measured on the exact arcs, the clearance grows by that, and the program is solved once more, until
the flight is clear.

What the certificate finds outside a gap or a height by more than rounding, as where a hoop is crossed at a flat angle,
is mended in the same way: the task is narrowed by what was found, and solved again from the flight.
"""

from __future__ import annotations

from dataclasses import replace

from flatgym.scenarios.scenario import Scenario
from optimal.direct import transcription as tr
from optimal.direct.guesses import warm_start
from optimal.direct.program import NODES, Shape, phase_steps
from optimal.direct.shooting import ShootingSolution, solve_from
from optimal.flights.certificate import TOLERANCE, Certificate, certify
from optimal.flights.replay import path_violation, replay_controls

CLEAR = TOLERANCE
"""Depth in a rim that counts as clear, and what the clearance grows by beyond the depth measured [m]."""
AMPLE = 1.1
"""By how many times the depth the clearance grows: when pushed out here, the body dips in again nearby."""
NEAR = 1e-3
"""A flight outside by more than this [m] is not mended but another one."""
ROUNDS = 8
"""Times the clearance may grow."""


def rim_depth(scenario: Scenario, shot: ShootingSolution) -> float:
    """Return how deep the body of a flight reaches into a rim, in continuous time [m]."""
    flight = shot.trajectory
    _, arcs = replay_controls(flight, scenario.quadrotor, scenario.start_state, flight.breakpoints, flight.states)
    return path_violation(arcs, replace(scenario, floor=None, ceiling=None))


def keep_clear(
    scenario: Scenario, shot: ShootingSolution, *, nodes: int = NODES, tolerant: bool = False
) -> ShootingSolution:
    """Return the flight nearby that keeps the body clear of all rims; one that does already is returned as it is.

    Args:
        scenario: what to fly.
        shot: a flight of the scenario's point, converged.
        nodes: steps of the whole flight, as for `solve_winding`.
        tolerant: whether it may end anywhere within the tolerance.
    """
    if not scenario.hoops or scenario.quadrotor.radius == 0:
        return shot
    steps = phase_steps(scenario, nodes)
    shape = Shape(steps, tr.limited(scenario), tolerant, rims=True)
    depth, clearance, iterations = rim_depth(scenario, shot), 0.0, shot.iterations
    for _ in range(ROUNDS):
        if depth <= CLEAR or not shot.converged:
            break
        guess = warm_start(shot.trajectory, steps)
        shot = solve_from(scenario, shape, shot.winding, guess, warm=True, clearance=clearance)
        iterations += shot.iterations
        depth = rim_depth(scenario, shot)
        clearance += AMPLE * depth + CLEAR
    return replace(shot, converged=shot.converged and depth <= CLEAR, iterations=iterations)


def tighten(
    scenario: Scenario, shot: ShootingSolution, certificate: Certificate
) -> tuple[ShootingSolution, Certificate]:
    """Return the flight nearby whose certificate holds, and that; the last one tried where none is found.

    Args:
        scenario: what to fly.
        shot: a flight of it, converged.
        certificate: of that flight.
    """
    room = 0.0
    for _ in range(ROUNDS):
        excess = max(certificate.max_path_violation, -certificate.hoop_clearance)
        if certificate.holds() or not (shot.converged and excess < NEAR):
            break
        room += AMPLE * excess + CLEAR
        rims = bool(scenario.hoops) and scenario.quadrotor.radius > 0
        shape = Shape(shot.steps, tr.limited(scenario), False, rims)
        guess = warm_start(shot.trajectory, shot.steps)
        shot = solve_from(narrowed(scenario, room), shape, shot.winding, guess, warm=True, clearance=room)
        certificate = certify(shot.trajectory, scenario)
    return shot, certificate


def narrowed(scenario: Scenario, room: float) -> Scenario:
    """Return a scenario whose gaps and heights are narrower by `room` [m], where the body, start and goal leave it."""
    heights = scenario.start[1], scenario.goal[1]
    floor, ceiling = scenario.floor, scenario.ceiling
    narrowest = 2 * (scenario.quadrotor.radius + CLEAR)
    return replace(
        scenario.with_diameters(max(hoop.diameter - 2 * room, narrowest) for hoop in scenario.hoops),
        floor=floor if floor is None or floor + room > min(heights) else floor + room,
        ceiling=ceiling if ceiling is None or ceiling - room < max(heights) else ceiling - room,
    )
