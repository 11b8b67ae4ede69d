"""TODO optimal/flights/replay.py."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flatgym.arc import Arc
from flatgym.quadrotor import Array, Quadrotor, nearest_turn
from flatgym.scenarios.scenario import Scenario
from optimal.flights.trajectory import Flight

AGREEMENT = 1e-6
"""Largest difference of a certified flight from its replay, and of its ends from rest [m, m/s, rad]."""
TURN = 3.0
"""Most that the tilt turns on one arc of a replay [rad]; the closed forms of `Arc` ask for less than a whole turn."""


def fine_grid(breakpoints: Array, parts: NDArray[np.intp]) -> Array:
    """Return the breakpoints (N + 1,) with every interval cut into so many parts (N,), shape (sum of parts + 1,)."""
    begin, part = np.repeat(breakpoints[:-1], parts), np.repeat(np.diff(breakpoints) / parts, parts)
    index = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(begin + part * index, breakpoints[-1])


def drift(error: Array, time: Array) -> Array:
    """Return what each interval adds to the errors (N + 1, 5) of a replay at its ends, shape (N,)."""
    added = np.diff(error, axis=0)
    added[:, 0:2] -= error[:-1, 2:4] * np.diff(time)[:, None]
    return np.abs(added).max(axis=1)


def replay_controls(
    flight: Flight, quadrotor: Quadrotor, start: Array, time: Array, states: Array
) -> tuple[Array, Arc]:
    """Fly the flight's controls, averaged over each interval of `time`, from a state (5,).

    Returns:
        The states at `time`, shape (n, 5), and the n - 1 arcs between them.

    The average rate is the change of the tilt over the interval, the thrust is taken in its middle.
    """
    dt = np.diff(time)
    middle = flight.control((time[:-1] + time[1:]) / 2)
    controls = np.stack([middle[:, 0], np.diff(states[:, 4]) / dt], axis=-1)
    replay = quadrotor.fly(start, controls, dt)
    return replay, Arc(quadrotor, replay[:-1], controls, dt)


def path_violation(arcs: Arc, scenario: Scenario) -> float:
    """Return the largest depth of the arcs below the floor, above the ceiling, or of the body in a hoop's rim [m]."""
    depth, up = 0.0, np.array([0.0, 1.0])
    if scenario.floor is not None:
        depth = max(depth, scenario.floor - float(arcs.lowest(up).min()))
    if scenario.ceiling is not None:
        depth = max(depth, -float(arcs.lowest(-up).min()) - scenario.ceiling)
    radius = scenario.quadrotor.radius
    for hoop in scenario.hoops if radius > 0 else ():
        for rim in hoop.rims:
            depth = max(depth, radius - float(arcs.distance(np.broadcast_to(rim, (len(arcs), 2))).min()))
    return depth


def hoop_crossings(arcs: Arc, scenario: Scenario) -> list[tuple[float, float]]:
    """Return (time [s], clearance [m]) of each hoop's crossing, each after the one before.

    The first crossing inside the gap counts, else the first at all; the list ends early at a hoop
    that is never crossed.
    """
    found: list[tuple[float, float]] = []
    begin, after, began = 0, 0.0, np.append(0.0, np.cumsum(arcs.dt))
    for hoop in scenario.hoops:
        rest = arcs[np.arange(begin, len(arcs))]
        shape = (len(rest), 2)
        earliest = np.zeros(len(rest))
        earliest[:1] = after
        when = rest.crossing(np.broadcast_to(hoop.centre, shape), np.broadcast_to(hoop.direction, shape), earliest)
        crossings = np.flatnonzero(~np.isnan(when))
        if not crossings.size:
            break
        aside = (rest[crossings].at(when[crossings])[:, 0:2] - hoop.centre) @ hoop.across
        clearance = hoop.half_gap(scenario.quadrotor.radius) - np.abs(aside)
        chosen = int(np.argmax(clearance >= -AGREEMENT))
        begin, after = begin + int(crossings[chosen]), float(when[crossings[chosen]])
        found.append((float(began[begin]) + after, float(clearance[chosen])))
    return found


def crossing_times(flight: Flight, scenario: Scenario) -> Array:
    """Return when a flight crosses each hoop [s], shape (H,) or shorter where one is never crossed."""
    time = flight.breakpoints
    states = flight.state(time)
    _, arcs = replay_controls(flight, scenario.quadrotor, states[0], time, states)
    return np.array([time for time, _ in hoop_crossings(arcs, scenario)])


def rest_error(state: Array, rest: Array) -> float:
    """Return the largest difference of a state from rest, theta modulo whole turns [m, m/s, rad]."""
    error = state - rest
    error[4] = nearest_turn(error[4])
    return float(np.abs(error).max())
