"""A corridor around a flight: outer paths close to it on both sides, through the gaps of its hoops.

The corridor of `optimal.paths.outer_paths` surrounds a rough centre line and must be wide. Around a flight that is near
a local optimum a narrow one suffices, and the narrower it is, the easier is eq. (10): where the thrust is small, the
rate is sensitive to the third derivatives of the outer paths, and these grow with the width.

The path coordinate is the share of the flight's duration, so that ds/dt is constant along the flight. Outer paths pass
a hoop together, on its line and within its gap. Everything that changes along the corridor (its width near rims, the
direction of its ribs) changes smoothly, so that splines represent it without ripples.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.interpolate import BSpline

from flatgym.quadrotor import Array, nearest_turn
from flatgym.scenarios.scenario import Hoop, Scenario
from optimal.flights.replay import crossing_times
from optimal.flights.trajectory import Flight
from optimal.paths.corridors import Corridor, end_weights
from optimal.paths.curves import BSplinePath, clamped_knots, smoothstep
from optimal.paths.gates import overlap
from optimal.paths.smoothing import SmoothMotion, averaged

WIDTH = 0.1
"""Room to either side of the flight [m]."""
OPENING = 0.5
"""Time from a hoop within which the outer paths come closer to pass its gap [s]."""
NEAR = 0.4
"""Height above the floor, or below the ceiling, in which the outer paths lie above each other [m]."""
SMOOTH = 3
"""Order of the smoothstep by which width and direction of the corridor change."""
KNOT_SPACING, LEAST_POINTS, DEGREE = 0.03, 16, 5
"""Time between knots of an outer path [s], its least number of control points, and its degree."""
SAMPLES = 8
"""Points of the fit for each control point."""
SLOW = 0.005
"""Share of the greatest speed below which a direction of flight is interpolated between its neighbours."""
TURN = 0.15
"""Time over which the direction of flight is averaged, which limits how fast the ribs of the corridor turn [s]."""
NEWTON_STEPS = 4
"""Newton steps from a crossing of the replay to one of the flight."""
TURNING = 0.15
"""Share of the speed in a hoop's direction below which a flight turns round at the hoop."""
BEYOND, NARROW = 1e-6, 0.02
"""Where a flight turns round at a hoop, the outer paths lie across the flight, not along the gap: one reaches BEYOND
over the hoop's line, the other NARROW farther [m]."""
CLEARANCE = 1e-3
"""Distance of the outer paths from a body's contact with a rim [m]."""
Fixed = tuple[float, Array]
"""A path coordinate and the point that a path passes there."""
CLIPPINGS = 8
"""Most rounds in which control points are moved to floor or ceiling."""


def corridor_around(motion: SmoothMotion, scenario: Scenario, passings: Array, width: float = WIDTH) -> Corridor:
    """Return two outer paths on both sides of a flight.

    Args:
        motion: the flight, smoothed.
        scenario: its scenario.
        passings: the times at which it crosses the hoops [s], shape (hoops,).
        width: room to either side [m].

    Returns:
        The corridor. Its paths are four times continuously differentiable, and at rest at both ends.

    Raises:
        ValueError: if the flight does not cross all hoops.
    """
    if len(passings) < len(scenario.hoops):
        raise ValueError(f"no corridor around a flight that crosses {len(passings)} of {len(scenario.hoops)} hoops")
    count = max(LEAST_POINTS, math.ceil(motion.duration / KNOT_SPACING) + DEGREE)
    s = np.linspace(0.0, 1.0, SAMPLES * count)
    times = s * motion.duration
    centre, angle = motion(times), _headings(motion, s) + math.pi / 2
    centre[0], centre[-1] = scenario.start, scenario.goal  # to the last digit; a coarse flight ends within 1e-8
    stations = np.array([0.0, *passings, motion.duration])
    rooms = np.full((2, len(s)), width)
    crossed: list[tuple[Hoop, float]] = []
    fixed: tuple[list[Fixed], list[Fixed]] = ([], [])
    for i, (hoop, passing) in enumerate(zip(scenario.hoops, passings, strict=False)):
        place, middle = motion(passing), float(np.interp(passing, times, angle))
        if not turns_round(motion(passing, 1), hoop):
            last, first = _gap(hoop, scenario)
            turn = nearest_turn(math.atan2(hoop.across[1], hoop.across[0]) - middle)
            angle = angle + _nearness(times, stations[i : i + 3]) * turn
            aside = float((place - hoop.centre) @ hoop.across)
            ends = (last - aside, aside - first)
            crossed.append((hoop, passing))
        else:
            inner = 0 if hoop.direction @ (math.cos(middle), math.sin(middle)) < 0 else 1
            ends = (0.0, NARROW) if inner == 0 else (NARROW, 0.0)
            over = BEYOND - (place - hoop.centre) @ hoop.direction
            fixed[inner].append((passing / motion.duration, place + over * hoop.direction))
        narrowed = 1 - np.clip(np.array(ends) / width, 0.0, 1.0)
        rooms *= 1 - narrowed[:, None] * _nearness(times, stations[[0, i + 1, -1]])
    angle = _upright_near_heights(angle, centre, scenario)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rooms *= _clear_of_rims(scenario, times, centre, normal, width)
    for hoop, passing in crossed:
        (last, first), aside = _gap(hoop, scenario), float((motion(passing) - hoop.centre) @ hoop.across)
        above, below = (np.interp(passing, times, room) for room in rooms)
        for path, coordinate in zip(fixed, (min(last, aside + above), max(first, aside - below)), strict=True):
            path.append((passing / motion.duration, hoop.centre + coordinate * hoop.across))
    targets = [_within(scenario, centre, sign * normal, room) for sign, room in zip((1.0, -1.0), rooms, strict=True)]
    paths = tuple(_fitted(s, targets[i], fixed[i], count, scenario) for i in range(2))
    return Corridor(paths, end_weights(paths, scenario.start, scenario.goal))


def passings_of(flight: Flight, scenario: Scenario) -> Array:
    """Return the times at which a flight crosses the hoops [s], shape (n,), up to the first that it does not cross."""
    times = crossing_times(flight, scenario)
    for i, hoop in enumerate(scenario.hoops[: len(times)]):
        for _ in range(NEWTON_STEPS):
            velocity, offset = flight(times[i], 1), flight(times[i]) - hoop.centre
            if not turns_round(velocity, hoop):
                times[i] -= offset @ hoop.direction / (velocity @ hoop.direction)
    return times


def turns_round(velocity: Array, hoop: Hoop) -> bool:
    """Return whether a flight with a velocity at a hoop touches its line rather than crosses it."""
    return bool(velocity @ hoop.direction <= TURNING * np.hypot(*velocity))


def _nearness(times: Array, stations: Array) -> Array:
    """Return a smooth function of time that is 1 at the second of three stations and 0 beyond OPENING, shape (n,).

    Args:
        times: instants [s], shape (n,).
        stations: times, between the first and the last of which the function is positive [s], shape (3,).
    """
    before, after = np.clip(np.diff(stations), KNOT_SPACING, OPENING)
    since = times - stations[1]
    near = np.maximum(1 - np.where(since < 0, -since / before, since / after), 0.0)
    return np.asarray(smoothstep(SMOOTH)(near))


def _headings(motion: SmoothMotion, s: Array) -> Array:
    """Return the direction of flight at path coordinates [rad], shape (n,), averaged over TURN."""
    velocity = motion(s * motion.duration, 1)
    speed = np.hypot(*velocity.T)
    moving = speed > SLOW * speed.max()
    heading = np.interp(s, s[moving], np.unwrap(np.arctan2(velocity[moving, 1], velocity[moving, 0])))
    width = 2 * round(TURN * len(s) / motion.duration / 2) + 1
    heading = averaged(heading, width, "symmetric")
    times = s * motion.duration
    for end, away in ((0, times), (-1, motion.duration - times)):
        heading += smoothstep(SMOOTH)(np.maximum(1 - away / TURN, 0.0)) * (heading[end] - heading)
    return heading


def _upright_near_heights(angle: Array, centre: Array, scenario: Scenario) -> Array:
    """Return the angles of the ribs, turned towards the vertical where floor or ceiling is near [rad], shape (n,).

    A rib that is cut by the floor has one end there. Its other coordinate then follows the flight if it is vertical.
    """
    low, high = scenario.heights
    height = np.minimum(centre[:, 1] - low, high - centre[:, 1])
    near = smoothstep(SMOOTH)(np.clip(1 - height / NEAR, 0.0, 1.0))
    vertical = math.pi * np.rint(angle / math.pi - 0.5) + math.pi / 2
    return np.asarray(angle + near * (vertical - angle))


def _gap(hoop: Hoop, scenario: Scenario) -> tuple[float, float]:
    """Return greatest and least coordinate of the usable gap along the hoop [m]."""
    half = hoop.half_gap(scenario.quadrotor.radius)
    ends = overlap(hoop, half, *scenario.heights)
    return (half, -half) if ends is None else (ends[1], ends[0])


def _clear_of_rims(scenario: Scenario, times: Array, centre: Array, normal: Array, width: float) -> Array:
    """Return the share of the width on both sides that a body leaves where it passes a rim closely, shape (2, n).

    Args:
        scenario: the scenario, with the radius of the body.
        times: instants [s], shape (n,).
        centre: the flight there [m], shape (n, 2).
        normal: unit vectors from the flight to the first outer path, shape (n, 2).
        width: room to either side of the flight [m].
    """
    share = np.ones((2, len(times)))
    for rim in (rim for hoop in scenario.hoops if scenario.quadrotor.radius > 0 for rim in hoop.rims):
        offset = rim - centre
        free = np.hypot(*offset.T) - scenario.quadrotor.radius
        for i in np.flatnonzero((free[1:-1] <= free[:-2]) & (free[1:-1] <= free[2:]) & (free[1:-1] < width)) + 1:
            narrowed = 1 - min(max((free[i] - CLEARANCE) / width, 0.0), 1.0)
            side = 0 if offset[i] @ normal[i] > 0 else 1
            share[side] *= 1 - narrowed * _nearness(times, np.array([times[0], times[i], times[-1]]))
    return share


def _within(scenario: Scenario, centre: Array, direction: Array, room: Array) -> Array:
    """Return the points at a distance from the centre line, less where floor or ceiling is nearer, shape (n, 2).

    The distance is a smooth function of the room and of the distance to floor or ceiling, and less than both.
    """
    low, high = scenario.heights
    rise = direction[:, 1]
    height = np.where(rise > 0, high - centre[:, 1], centre[:, 1] - low)
    free = np.maximum(height, 0.0) / np.maximum(np.abs(rise), 1e-9)
    return centre + (room * np.tanh(free / np.maximum(room, 1e-12)))[:, None] * direction


def _fitted(s: Array, targets: Array, fixed: list[Fixed], count: int, scenario: Scenario) -> BSplinePath:
    """Return the B-spline nearest to points that rests at its ends, passes fixed points and keeps the heights.

    Args:
        s: path coordinates, shape (n,).
        targets: points there, shape (n, 2).
        fixed: path coordinates and points that the path passes exactly.
        count: number of control points.
        scenario: its floor and ceiling limit the control points, and so the path.
    """
    knots, every = clamped_knots(count, DEGREE), np.eye(count)
    matrix = BSpline.design_matrix(s, knots, DEGREE).toarray()
    ends = [(every[i], targets[end]) for i, end in ((0, 0), (1, 0), (-2, -1), (-1, -1))]
    passed = [(BSpline.design_matrix([at], knots, DEGREE).toarray()[0], point) for at, point in fixed]
    rows, values = (np.array(part) for part in zip(*ends, *passed, strict=True))
    low, high = scenario.heights
    # The vehicle is upright at rest, so x'' vanishes there.
    upright = [every[2], every[-3]], [targets[0, 0], targets[-1, 0]]
    x = _constrained_fit(matrix, targets[:, 0], np.array([*rows, *upright[0]]), np.array([*values[:, 0], *upright[1]]))
    limited: dict[int, float] = {}
    for _ in range(CLIPPINGS):
        further = [every[i] for i in limited]
        z = _constrained_fit(
            matrix, targets[:, 1], np.array([*rows, *further]), np.array([*values[:, 1], *limited.values()])
        )
        outside = [i for i in range(2, count - 2) if not low <= z[i] <= high and i not in limited]
        if not outside:
            break
        limited |= {i: low if z[i] < low else high for i in outside}
    z = np.clip(z, low, high)
    return BSplinePath(tuple(zip(x.tolist(), z.tolist(), strict=True)), DEGREE, tuple(knots.tolist()))


def _constrained_fit(matrix: Array, values: Array, rows: Any, fixed: Any) -> Array:
    """Return the coefficients c of least |matrix c - values| with rows c = fixed, shape (m,)."""
    base = np.linalg.lstsq(rows, fixed, rcond=None)[0]
    free = np.linalg.svd(rows)[2][np.linalg.matrix_rank(rows) :].T
    return np.asarray(base + free @ np.linalg.lstsq(matrix @ free, values - matrix @ base, rcond=None)[0])
