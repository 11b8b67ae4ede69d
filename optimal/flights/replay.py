"""The replay of a flight: held controls that stand for its own over short intervals, through the exact step.

The replay is a sequence of arcs in closed form (`flatgym.arc`). Depths in floor, ceiling and rims, and the crossings of
hoops, are computed on these arcs in continuous time.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flatgym.arc import Arc
from flatgym.quadrotor import Array, Quadrotor, nearest_turn
from flatgym.scenarios.scenario import Scenario
from optimal.flights.trajectory import Flight

REPLAY_TOLERANCE = 1e-6
"""Largest difference of a certified flight from its replay, and of its ends from rest [m, m/s, rad]."""
MAX_TURN = 3.0
"""Largest rotation on one arc of a replay [rad]; the closed forms of `Arc` need less than a whole turn."""
MAX_REFINEMENT, LEAST_FALL, MAX_PARTS = 16, 16, 2**16
"""Largest factor of one refinement of the replay, least factor by which the error should fall, and most parts of an
interval between breakpoints."""
ORDER, GAUSS = 4, math.sqrt(3) / 6
"""Order of the replay in the number of parts, and distance of the Gauss points from the middle of a part, relative to
its length."""


def fine_grid(breakpoints: Array, parts: NDArray[np.intp]) -> Array:
    """Return breakpoints (N + 1,) with interval i divided into parts[i] parts, shape (sum of parts + 1,)."""
    begin, part = np.repeat(breakpoints[:-1], parts), np.repeat(np.diff(breakpoints) / parts, parts)
    index = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(begin + part * index, breakpoints[-1])


def added_errors(error: Array, time: Array) -> Array:
    """Return the contribution of each interval to the errors (N + 1, 5) of a replay at its ends, shape (N,)."""
    added = np.diff(error, axis=0)
    added[:, 0:2] -= error[:-1, 2:4] * np.diff(time)[:, None]
    return np.abs(added).max(axis=1)


def replay_controls(
    flight: Flight, quadrotor: Quadrotor, start: Array, time: Array, states: Array
) -> tuple[Array, Arc]:
    """Replay a flight's controls from a state (5,), with two arcs between neighbouring instants.

    The arcs hold m - d / 3 and m + d / 3 for half of the interval each. Here m is the mean of the controls, of the
    thrust at the two Gauss points and of the rate by the change of the tilt, and d is the change of the controls over
    the interval, extrapolated from the Gauss points. The replay is exact for held controls, and its error falls with
    the fourth power of the length of the intervals for smooth controls (commutator-free Magnus integrator of fourth
    order: Blanes and Moan, Applied Numerical Mathematics 56, 2006). The tilt is exact at the ends of the intervals,
    even if the rate jumps between them.

    Args:
        flight: the flight.
        quadrotor: its vehicle.
        start: the first state of the replay, shape (5,).
        time: instants from 0 to the duration [s], shape (n,).
        states: the flight's states there, shape (n, 5).

    Returns:
        The replay's states at `time`, shape (n, 5), and the 2 (n - 1) arcs between them.
    """
    dt = np.diff(time)
    middle, aside = (time[:-1] + time[1:]) / 2, GAUSS * dt
    before, after = flight.control(middle - aside), flight.control(middle + aside)
    mean, third = (before + after) / 2, (after - before) / (6 * GAUSS)
    mean[:, 1] = np.diff(states[:, 4]) / dt
    room = np.maximum(np.minimum(mean - quadrotor.control_low, quadrotor.control_high - mean), 0.0)
    third = np.clip(third, -room, room)  # a jump between the Gauss points is extrapolated beyond the limits
    controls = np.stack([mean - third, mean + third], axis=1).reshape(-1, 2)
    halves = np.repeat(dt / 2, 2)
    replay = quadrotor.fly(start, controls, halves)
    return replay[::2], Arc(quadrotor, replay[:-1], controls, halves)


def converged_replay(flight: Flight, scenario: Scenario) -> tuple[Array, Array, Arc]:
    """Replay a flight's controls on arcs that are refined until the replay agrees with the flight.

    Returns:
        The flight's states and the replay's states at n instants, shapes (n, 5), and the 2 (n - 1) arcs, two between
        neighbouring instants. The refinement also ends at states that are not finite, at errors that do not fall, and
        at MAX_PARTS.
    """
    rotation = np.abs(np.diff(flight.state(flight.breakpoints)[:, 4]))
    parts = np.maximum(np.ceil(np.nan_to_num(rotation, posinf=0.0) / MAX_TURN), 1).astype(np.intp)
    largest = math.inf
    while True:
        time = fine_grid(flight.breakpoints, parts)
        states = flight.state(time)
        replay, arcs = replay_controls(flight, scenario.quadrotor, scenario.start_state, time, states)
        if not (np.isfinite(states).all() and np.isfinite(replay).all()):
            break
        ends = np.append(0, np.cumsum(parts))
        added = added_errors(replay[ends] - states[ends], time[ends])
        # An error that does not fall is not caused by the arcs: the flight does not follow its controls.
        if (
            np.abs(replay - states).max() <= REPLAY_TOLERANCE / 2
            or added.max() > largest / 2
            or parts.max() >= MAX_PARTS
        ):
            break
        largest = added.max()
        aim = min(REPLAY_TOLERANCE / 4 / math.sqrt(len(parts)), largest / LEAST_FALL)
        parts = np.ceil(parts * np.clip((added / aim) ** (1 / ORDER), 1, MAX_REFINEMENT)).astype(np.intp)
    return states, replay, arcs


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
    """Return (time [s], clearance [m]) of the crossing of each hoop, each after the previous one.

    The first crossing inside the gap counts; without one, the crossing nearest to the gap. The list ends before a hoop
    that is never crossed.
    """
    found: list[tuple[float, float]] = []
    begin, after, began = 0, 0.0, np.append(0.0, np.cumsum(arcs.dt))
    for hoop in scenario.hoops:
        rest = arcs[np.arange(begin, len(arcs))]
        shape = (len(rest), 2)
        earliest = np.zeros(len(rest))
        earliest[:1] = after
        line = np.broadcast_to(hoop.centre, shape), np.broadcast_to(hoop.direction, shape)
        when = rest.crossing(*line, earliest)
        # By rounding, an arc may end just before the line and the next one begin on it.
        ends, begins = rest.height_over(*line, rest.dt)[0][:-1], rest.height_over(*line, 0 * rest.dt)[0][1:]
        when[1:][(ends < 0) & (begins >= 0)] = 0.0
        crossings = np.flatnonzero(~np.isnan(when))
        if not crossings.size:
            break
        aside = (rest[crossings].at(when[crossings])[:, 0:2] - hoop.centre) @ hoop.across
        clearance = hoop.half_gap(scenario.quadrotor.radius) - np.abs(aside)
        inside = clearance >= -REPLAY_TOLERANCE
        chosen = int(np.argmax(inside if inside.any() else clearance))
        begin, after = begin + int(crossings[chosen]), float(when[crossings[chosen]])
        found.append((float(began[begin]) + after, float(clearance[chosen])))
    return found


def crossing_times(flight: Flight, scenario: Scenario) -> Array:
    """Return the times at which a flight crosses the hoops [s], shape (H,), or shorter if one is never crossed."""
    time = flight.breakpoints
    states = flight.state(time)
    _, arcs = replay_controls(flight, scenario.quadrotor, states[0], time, states)
    return np.array([time for time, _ in hoop_crossings(arcs, scenario)])


def rest_error(state: Array, rest: Array) -> float:
    """Return the largest difference of a state (5,) from a state at rest, theta modulo 2 pi [m, m/s, rad]."""
    error = state - rest
    error[4] = nearest_turn(error[4])
    return float(np.abs(error).max())
