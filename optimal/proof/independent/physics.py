"""What is possible from thrust alone: on any line the vehicle is at best a double integrator.

Along a unit vector d its acceleration lies between -(thrust_max + g d_z) and thrust_max - g d_z, for any tilt. Rates
are ignored, which can only make more flights possible.
"""

from __future__ import annotations

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario, Tolerance

_ANGLES = np.linspace(0.0, 2 * np.pi, 7200, endpoint=False)
_UNITS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Unit vectors; any set of them gives valid bounds."""
BISECTIONS = 60
MARGIN = 1e-9
"""Margin of times and distances, relative."""


def ends_allowed(tolerance: Tolerance | None) -> tuple[float, float]:
    """Return the greatest distance to the goal [m] and the greatest speed [m/s] at the end."""
    return (0.0, 0.0) if tolerance is None else (tolerance.position, tolerance.speed)


def least_flight_time(scenario: Scenario, tolerance: Tolerance | None) -> float:
    """Return a time [s] that no flight from start to goal beats.

    On a line: accelerate to the speed p with a, brake with b to the final speed v, over the distance
    x = p^2/(2 a) + (p^2 - v^2)/(2 b).
    """
    q, (near, v) = scenario.quadrotor, ends_allowed(tolerance)
    x = (np.array(scenario.goal) - scenario.start) @ _UNITS - near
    a, b = q.thrust_max - q.gravity * _UNITS[1], q.thrust_max + q.gravity * _UNITS[1]
    x, a, b = x[x > 0], a[x > 0], b[x > 0]
    if not x.size:
        return 0.0
    peak = np.sqrt((2 * x + v * v / b) / (1 / a + 1 / b))
    never_brakes = peak <= v
    time = np.where(never_brakes, np.sqrt(2 * x / a), peak / a + (peak - v) / b)
    return float(time.max())


def possible_windows(scenario: Scenario, time: float, tolerance: Tolerance | None) -> Array:
    """Return the first and last time at which a flight of a duration can pass each hoop [s], shape (H, 2)."""
    near, v = ends_allowed(tolerance)
    first, last = [], []
    for hoop in scenario.hoops:
        half = hoop.diameter / 2 - scenario.quadrotor.radius
        first.append(_fall(scenario, hoop.centre - scenario.start, half, 0.0, up=1.0))
        last.append(time - _fall(scenario, scenario.goal - hoop.centre, half + near, v, up=-1.0))
    low = np.maximum.accumulate(np.array(first)) if first else np.zeros(0)
    high = np.minimum.accumulate(np.array(last)[::-1])[::-1] if last else np.zeros(0)
    return np.stack([low, high], axis=-1)


def _fall(scenario: Scenario, way: Array, slack: float, v: float, up: float) -> float:
    """Return the least time to cover a displacement with an acceleration from speed v, or braking to it (up = -1)."""
    q = scenario.quadrotor
    x = np.maximum(way @ _UNITS - slack, 0.0)
    a = q.thrust_max - up * q.gravity * _UNITS[1]
    return float(((np.sqrt(v * v + 2 * a * x) - v) / a).max())


def speed_bound(a: float, b: float, before: float, after: float, early: float, late: float, time: float) -> float:
    """Return a bound of the speed along a direction, at a place on it, of a flight from rest to rest [m/s].

    With accelerations between -b and a, a vehicle that starts at rest a distance x behind the place and passes it at
    speed v either speeds up directly, or draws back first and passes its start at speed w in time
    v/a + (1/a + 1/b) w, w^2 = (v^2/a - 2 x) / (1/a + 1/b).

    Args:
        a, b: limits of the acceleration [m/s^2].
        before, after: greatest distances of the place from start and goal, along the direction [m].
        early, late: greatest times before and after the passage [s].
        time: greatest time of the flight [s].
    """

    def needed(v: float, ahead: float, back: float, x: float) -> float:
        w = np.sqrt(max(v * v / ahead - 2 * x, 0.0) / (1 / ahead + 1 / back))
        return float(v / ahead + (1 / ahead + 1 / back) * w)

    low = float(np.sqrt(max(2 * a * max(before, 0.0), 2 * b * max(after, 0.0))))
    high = low + max(a, b) * time
    for _ in range(BISECTIONS):
        v = (low + high) / 2
        first, last = needed(v, a, b, before), needed(v, b, a, after)
        low, high = (v, high) if first <= early and last <= late and first + last <= time else (low, v)
    return max(min(high, a * early, b * late, time / (1 / a + 1 / b)), 0.0)
