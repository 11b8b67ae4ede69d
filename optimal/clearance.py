"""Bodies with a radius: a flight that keeps clear of the rims in continuous time.

A point that crosses the middle of the gap may still touch a rim with its body before or after. So
the flight of the point comes first; then, starting from it, the distance to both rim points is
constrained at the quarter points of all arcs around the crossing,

    |p - rim|^2 >= (radius + clearance)^2.

Between the quarter points the body can still dip in, by half a millimetre or so: how deep is
measured on the exact arcs, the clearance grows by that, and the program is solved once more, until
the flight is clear.
"""

from __future__ import annotations

from dataclasses import replace

from flatgym.scenario import Scenario
from optimal import transcription as tr
from optimal.certificate import TOLERANCE, fly_again, path_violation
from optimal.shooting import NODES, Shape, Shot, attempt, packed, phase_steps

CLEAR = TOLERANCE
"""Depth in a rim that counts as clear, and what the clearance grows by beyond the depth measured [m]."""
AMPLE = 1.1
"""By how many times the depth the clearance grows: when pushed out here, the body dips in again nearby."""
ROUNDS = 8
"""Times the clearance may grow."""


def rim_depth(scenario: Scenario, shot: Shot) -> float:
    """Return how deep the body of a flight reaches into a rim, in continuous time [m]."""
    flight = shot.trajectory
    _, arcs = fly_again(flight, scenario, flight.breakpoints, flight.states)
    return path_violation(arcs, replace(scenario, floor=None, ceiling=None))


def keep_clear(scenario: Scenario, shot: Shot, *, nodes: int = NODES, tolerant: bool = False) -> Shot:
    """Return the flight nearby that keeps the body clear of all rims; one that does already is returned as it is.

    Args:
        scenario: what to fly.
        shot: a flight of the scenario's point, converged.
        nodes: steps of the whole flight, as for `shoot`.
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
        guess = packed(shot.trajectory, steps)
        shot = attempt(scenario, shape, shot.winding, guess, warm=True, clearance=clearance)
        iterations += shot.iterations
        depth = rim_depth(scenario, shot)
        clearance += AMPLE * depth + CLEAR
    return replace(shot, converged=shot.converged and depth <= CLEAR, iterations=iterations)
