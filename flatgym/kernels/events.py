"""Events within one step of one vehicle: the compiled version of `flatgym.arc`, which has the theory.

An arc is a tuple (x, z, vx, vz, theta, thrust, rate, pull_x, pull_z): the state at the beginning of the step, its
constant control, and the acceleration by gravity and wind. A test holds both versions together.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flatgym.arc import ROOT_ITERATIONS, ROOT_WIDTH, SAGITTA_TOLERANCE
from flatgym.kernels.layout import compiled

HEIGHT, SPEED, APPROACH = 0, 1, 2
"""Event functions: (p - point) . direction, p' . direction, and half the time derivative of |p - point|^2."""
PARTS = 128
"""Capacity of the stack of subintervals in `distance`; bisection to SAGITTA_TOLERANCE needs fewer than 40."""


@compiled
def at(arc: Any, time: float) -> Any:
    """Return x, z, vx, vz and the acceleration ax, az `time` seconds into the step."""
    x, z, vx, vz, theta, thrust, rate, pull_x, pull_z = arc
    a = rate * time / 2
    sin, cos = math.sin(theta + a), math.cos(theta + a)
    q = a * a
    if q < 0.25:
        j0 = 1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110 * (1 - q / 156)))))
        j1 = a / 3 * (1 - q / 10 * (1 - q / 28 * (1 - q / 54 * (1 - q / 88 * (1 - q / 130)))))
    else:
        j0 = math.sin(a) / a
        j1 = (math.sin(a) - a * math.cos(a)) / q
    dv, half = thrust * time, time / 2
    return (
        x + (vx + pull_x * half) * time + dv * half * (j0 * sin - j1 * cos),
        z + (vz + pull_z * half) * time + dv * half * (j0 * cos + j1 * sin),
        vx + dv * j0 * sin + pull_x * time,
        vz + dv * j0 * cos + pull_z * time,
        thrust * math.sin(theta + rate * time) + pull_x,
        thrust * math.cos(theta + rate * time) + pull_z,
    )


@compiled
def event(arc: Any, kind: int, px: float, pz: float, dx: float, dz: float, time: float) -> Any:
    """Return an event function, one of HEIGHT, SPEED and APPROACH, and its time derivative."""
    x, z, vx, vz, ax, az = at(arc, time)
    if kind == HEIGHT:
        return (x - px) * dx + (z - pz) * dz, vx * dx + vz * dz
    if kind == SPEED:
        return vx * dx + vz * dz, ax * dx + az * dz
    return (x - px) * vx + (z - pz) * vz, vx * vx + vz * vz + (x - px) * ax + (z - pz) * az


@compiled
def rising_root(
    arc: Any, kind: int, px: float, pz: float, dx: float, dz: float, low: float, high: float, sign: float
) -> float:
    """Return the rising root of `sign` times an event function in [low, high]: the upper end of the final bracket."""
    time = (low + high) / 2
    for _ in range(ROOT_ITERATIONS):
        value, slope = event(arc, kind, px, pz, dx, dz, time)
        rising = sign * value >= 0
        if rising:
            high = time
        else:
            low = time
        if high - low <= ROOT_WIDTH:
            break
        # Slightly beyond Newton's point, so that both ends of the bracket move.
        newton = time - value / slope - (ROOT_WIDTH / 4 if rising else -ROOT_WIDTH / 4)
        time = newton if low < newton < high else (low + high) / 2
    return high


@compiled
def inflections(arc: Any, dt: float, dx: float, dz: float) -> Any:
    """Return the two times at which p'' . direction is zero, in order; dt where there is none within the step [s]."""
    _, _, _, _, theta, thrust, rate, pull_x, pull_z = arc
    ratio = -(pull_x * dx + pull_z * dz) / max(thrust, 1e-300)
    if rate == 0 or abs(ratio) > 1:
        return dt, dt
    beta, spread = math.atan2(dx, dz), math.acos(ratio)
    sign = 1.0 if rate > 0 else -1.0
    first = (sign * (beta - spread - theta)) % (2 * math.pi) / abs(rate)
    second = (sign * (beta + spread - theta)) % (2 * math.pi) / abs(rate)
    first, second = min(first, second), max(first, second)
    return min(first, dt), min(second, dt)


@compiled
def monotone_times(arc: Any, dt: float, dx: float, dz: float) -> Any:
    """Return five times from 0 to dt; between two of them p . direction is monotone [s]."""
    first, second = inflections(arc, dt, dx, dz)
    knots = (0.0, first, second, dt)
    times = np.zeros(5)
    before = event(arc, SPEED, 0.0, 0.0, dx, dz, 0.0)[0]
    for i in range(3):
        then = event(arc, SPEED, 0.0, 0.0, dx, dz, knots[i + 1])[0]
        times[i + 1] = knots[i + 1]
        if before * then < 0:
            sign = 1.0 if then > 0 else -1.0
            times[i + 1] = rising_root(arc, SPEED, 0.0, 0.0, dx, dz, knots[i], knots[i + 1], sign)
        before = then
    times[4] = dt
    return times


@compiled
def crossing(arc: Any, dt: float, px: float, pz: float, dx: float, dz: float, after: float, end: float) -> float:
    """Return the first time later than `after` at which the path crosses a line from below to above [s], or nan.

    `end` is the height over the line at the end of the step, computed from the state in which the next step begins.
    Computing it here with other rounding could lose a crossing between two steps.
    """
    times = monotone_times(arc, dt, dx, dz)
    low = max(times[0], after)
    before = event(arc, HEIGHT, px, pz, dx, dz, low)[0]
    for i in range(1, 5):
        high = max(times[i], after)
        then = event(arc, HEIGHT, px, pz, dx, dz, high)[0] if high < dt else end
        if before < 0 <= then:
            return rising_root(arc, HEIGHT, px, pz, dx, dz, low, high, 1.0)
        low, before = high, then
    return math.nan


@compiled
def lowest(arc: Any, dt: float, dx: float, dz: float) -> float:
    """Return the minimum of p . direction over the step [m]."""
    least = math.inf
    for time in monotone_times(arc, dt, dx, dz):
        least = min(least, event(arc, HEIGHT, 0.0, 0.0, dx, dz, time)[0])
    return least


@compiled
def distance(arc: Any, dt: float, px: float, pz: float, within: float) -> float:
    """Return a lower bound of the distance to a point over the step [m], tight to 1e-9 if it is below `within`."""
    _, _, _, _, _, thrust, rate, pull_x, pull_z = arc
    acceleration, jerk = thrust + math.hypot(pull_x, pull_z), thrust * abs(rate)
    parts = np.empty((PARTS, 2))
    parts[0, 0], parts[0, 1] = 0.0, dt
    waiting = 1
    least = min(_distance_at(arc, px, pz, 0.0), _distance_at(arc, px, pz, dt))
    while waiting > 0 and least >= within:
        waiting -= 1
        low, high = parts[waiting, 0], parts[waiting, 1]
        width = high - low
        _, _, vx, vz, ax, az = at(arc, low)
        # A hovering vehicle has almost no acceleration; this bound then ends the bisection early.
        most = min(acceleration, math.hypot(ax, az) + jerk * width)
        sagitta = most * width**2 / 8
        floor = _chord_distance(arc, px, pz, low, high) - sagitta
        if floor >= min(least, within):
            continue
        slope_low, bend_low = event(arc, APPROACH, px, pz, 0.0, 0.0, low)
        slope_high, bend_high = event(arc, APPROACH, px, pz, 0.0, 0.0, high)
        speed = math.hypot(vx, vz) + most * width
        third = 3 * speed * most + (_distance_at(arc, px, pz, low) + speed * width) * jerk
        bow = third * width**2 / 8
        if min(slope_low, slope_high) >= bow or max(slope_low, slope_high) <= -bow:
            continue
        if min(bend_low, bend_high) >= third * width / 2:
            if slope_low < 0 < slope_high:
                time = rising_root(arc, APPROACH, px, pz, 0.0, 0.0, low, high, 1.0)
                least = min(least, _distance_at(arc, px, pz, time))
            continue
        if sagitta <= SAGITTA_TOLERANCE or waiting + 2 > PARTS:
            least = floor
            continue
        middle = (low + high) / 2
        least = min(least, _distance_at(arc, px, pz, middle))
        parts[waiting, 0], parts[waiting, 1] = low, middle
        parts[waiting + 1, 0], parts[waiting + 1, 1] = middle, high
        waiting += 2
    return max(least, 0.0)


@compiled
def _distance_at(arc: Any, px: float, pz: float, time: float) -> float:
    """Return the distance to a point `time` seconds into the step [m]."""
    x, z, _, _, _, _ = at(arc, time)
    return math.hypot(x - px, z - pz)


@compiled
def _chord_distance(arc: Any, px: float, pz: float, low: float, high: float) -> float:
    """Return the distance of a point to the chord between two times of the step [m]."""
    x, z, _, _, _, _ = at(arc, low)
    to_x, to_z, _, _, _, _ = at(arc, high)
    chord_x, chord_z = to_x - x, to_z - z
    length = max(chord_x**2 + chord_z**2, 1e-300)
    share = min(max(((px - x) * chord_x + (pz - z) * chord_z) / length, 0.0), 1.0)
    return math.hypot(x + share * chord_x - px, z + share * chord_z - pz)
