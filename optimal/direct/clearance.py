"""Constraint tightening: bodies keep clear of rims in continuous time, and small violations are repaired.

A body whose centre crosses the gap may still touch a rim before or after the crossing. The flight of a point is solved
first. Starting from it, the distance to both rim points is constrained at the quarter points of all arcs around the
crossing,

    |p - rim|^2 >= (radius + clearance)^2.

Between the quarter points the body can still dip in, by about half a millimetre. The depth is measured on the exact
arcs, the clearance grows by it, and the program is solved again, until the flight is clear.

A violation of a gap or a height found by the certificate is repaired in the same way. It occurs where a hoop is crossed
at a flat angle. The limits of the task are tightened by the violation, and the task is solved again from the flight.
"""

from __future__ import annotations

from dataclasses import replace

from flatgym.scenarios.scenario import Scenario
from optimal.direct.guesses import warm_start
from optimal.direct.program import Shape
from optimal.direct.shooting import ShootingSolution, solve_from
from optimal.direct.transcription import distinct_hoops, has_height_limits
from optimal.flights.certificate import TOLERANCE, Certificate, certify
from optimal.flights.replay import path_violation, replay_controls

MARGIN = TOLERANCE
"""Depth in a rim that counts as clear, and growth of the clearance beyond the measured depth [m]."""
GROWTH = 1.1
"""Growth of the clearance over the measured depth: a body pushed out here dips in again nearby."""
LARGEST_REPAIR = 1e-3
"""Largest violation that is repaired [m]; beyond it the result would be a different flight."""
ROUNDS = 8
"""Most increases of the clearance."""


def rim_depth(scenario: Scenario, shot: ShootingSolution) -> float:
    """Return the largest depth of a flight's body in a rim, in continuous time [m]."""
    flight = shot.trajectory
    _, arcs = replay_controls(flight, scenario.quadrotor, scenario.start_state, flight.breakpoints, flight.states)
    return path_violation(arcs, replace(scenario, floor=None, ceiling=None))


def keep_clear(scenario: Scenario, shot: ShootingSolution, *, tolerant: bool = False) -> ShootingSolution:
    """Return the nearby flight, on the same grid, that keeps the body clear of all rims.

    Args:
        scenario: the task.
        shot: a converged flight of the scenario for a point; one that is clear is returned unchanged.
        tolerant: whether the flight may end anywhere within the tolerance.
    """
    if not scenario.hoops or scenario.quadrotor.radius == 0:
        return shot
    shape = Shape(shot.steps, has_height_limits(scenario), tolerant, rims=True)
    depth, clearance, iterations = rim_depth(scenario, shot), 0.0, shot.iterations
    for _ in range(ROUNDS):
        if depth <= MARGIN or not shot.converged:
            break
        guess = warm_start(shot.trajectory, shot.steps)
        shot = solve_from(scenario, shape, shot.winding, guess, warm=True, clearance=clearance)
        iterations += shot.iterations
        depth = rim_depth(scenario, shot)
        clearance += GROWTH * depth + MARGIN
    return replace(shot, converged=shot.converged and depth <= MARGIN, iterations=iterations)


def tighten(
    scenario: Scenario, shot: ShootingSolution, certificate: Certificate
) -> tuple[ShootingSolution, Certificate]:
    """Return a nearby flight whose certificate holds, and the certificate; the last one tried if none is found.

    Args:
        scenario: the task.
        shot: a converged flight of it.
        certificate: of that flight.
    """
    margin = 0.0
    for _ in range(ROUNDS):
        violation = max(certificate.max_path_violation, -certificate.hoop_clearance)
        if certificate.holds() or not (shot.converged and violation < LARGEST_REPAIR):
            break
        margin += GROWTH * violation + MARGIN
        rims = bool(scenario.hoops) and scenario.quadrotor.radius > 0
        shape = Shape(shot.steps, has_height_limits(scenario), False, rims)
        guess = warm_start(shot.trajectory, shot.steps)
        flown = tightened_limits(distinct_hoops(scenario), margin)
        shot = solve_from(flown, shape, shot.winding, guess, warm=True, clearance=margin)
        certificate = certify(shot.trajectory, scenario)
    return shot, certificate


def tightened_limits(scenario: Scenario, margin: float) -> Scenario:
    """Return a scenario with gaps and heights tightened by `margin` [m], as far as body, start and goal allow."""
    heights = scenario.start[1], scenario.goal[1]
    floor, ceiling = scenario.floor, scenario.ceiling
    narrowest = 2 * (scenario.quadrotor.radius + MARGIN)
    return replace(
        scenario.with_diameters(max(hoop.diameter - 2 * margin, narrowest) for hoop in scenario.hoops),
        floor=floor if floor is None or floor + margin > min(heights) else floor + margin,
        ceiling=ceiling if ceiling is None or ceiling - margin < max(heights) else ceiling - margin,
    )
