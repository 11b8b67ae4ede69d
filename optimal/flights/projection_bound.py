"""The projection bound: a lower bound of the flight time from thrust alone.

Project the flight on a unit vector d. The acceleration along d lies between -(thrust_max + g d_z) and
thrust_max - g d_z, for any tilt. The vehicle is at best a double integrator on a line. To cover D . d from rest and
arrive at speed v_e or less, it needs at least

    T = v/a1 + (v - v_e)/a2,   v^2 = (2 D.d + v_e^2/a2) a1 a2 / (a1 + a2),

with a1 = thrust_max - g d_z and a2 = thrust_max + g d_z. Every d gives a valid bound, and so does the largest over any
set of directions. Rates, hoops and heights are ignored, which can only lower the bound. The argument is short and easy
to check; the bound is not tight.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario, Tolerance

DIRECTIONS = 7200
"""Number of unit vectors d."""
SPEED_HALVINGS = 50
"""Halvings of the range of a speed."""
Interval = tuple[float, float]


def passing_windows(
    scenario: Scenario, duration: float, tolerance: Tolerance | None = None
) -> list[tuple[float, float]]:
    """Return the window of each hoop, as shares of the duration, in which any flight not longer passes it.

    The argument is that of the projection bound. Before a hoop the vehicle comes from rest, t = sqrt(2 D.d / a1) at
    best. After the hoop it must slow down to rest, or to v_e.

    Args:
        scenario: the task.
        duration: the longest flight in question [s].
        tolerance: at the goal; None means exactly at rest.
    """
    slack, speed = (0.0, 0.0) if tolerance is None else (tolerance.position, tolerance.speed)
    before, after = [], []
    for hoop in scenario.hoops:
        gap = hoop.half_gap(scenario.quadrotor.radius)
        before.append(_least_time(scenario, hoop.centre - scenario.start, gap, 0.0, 1))
        after.append(_least_time(scenario, scenario.goal - hoop.centre, gap + slack, speed, -1))
    earliest = np.maximum.accumulate(before) / duration
    latest = 1 - np.maximum.accumulate(after[::-1])[::-1] / duration
    return list(zip(earliest.tolist(), latest.tolist(), strict=True))


def greatest_speed(
    pulls: tuple[float, float], before: Interval, after: Interval, limits: tuple[float, float, float]
) -> float:
    """Return a bound of the speed v along a direction at which a flight passes a place, from rest to rest [m/s].

    On a line with accelerations between -a2 and a1, the least time from rest to speed v after a distance d is

        v/a1 + (1/a1 + 1/a2) w,   w^2 = (v^2/a1 - 2 d) a1 a2 / (a1 + a2),   if d <= v^2/(2 a1):

    the vehicle draws back first, to the speed -w. The time after the place is that of the flight reversed in time.

    Args:
        pulls: a1 and a2 [m/s^2].
        before, after: ranges of the distances along the direction from the start, and to the goal [m].
        limits: greatest times before the place, after it, and of the whole flight [s].
    """
    # A greater distance than v^2 / (2 a1) only takes longer.
    low = max(np.sqrt(2 * pulls[0] * max(before[1], 0.0)), np.sqrt(2 * pulls[1] * max(after[1], 0.0)))
    high = low + max(pulls) * limits[2]

    def possible(speed: float) -> bool:
        times = [_time_to_speed(speed, *pulls, before[1]), _time_to_speed(speed, *pulls[::-1], after[1])]
        return times[0] <= limits[0] and times[1] <= limits[1] and sum(times) <= limits[2]

    for _ in range(SPEED_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if possible(middle) else (low, middle)
    ahead, back = pulls
    # It also takes v/a1 to reach the speed and v/a2 to lose it, wherever the place is.
    return float(min(high, ahead * limits[0], back * limits[1], limits[2] * ahead * back / (ahead + back)))


def _time_to_speed(speed: float, ahead: float, back: float, distance: float) -> float:
    """Return the least time from rest to a speed, after at most a distance of at most speed^2 / (2 ahead) [s]."""
    drawn = np.sqrt(max(speed**2 / ahead - 2 * distance, 0.0) * ahead * back / (ahead + back))
    return float(speed / ahead + (1 / ahead + 1 / back) * drawn)


def _least_time(scenario: Scenario, way: Array, slack: float, speed: float, sign: int) -> float:
    """Return the least time [s] from rest over a displacement.

    Args:
        scenario: the limits of its vehicle are used.
        way: displacement [m], shape (2,).
        slack: part of it that need not be covered [m].
        speed: initial speed for sign 1, final speed for sign -1 [m/s].
        sign: 1 accelerates, -1 brakes.
    """
    direction, q = _directions(), scenario.quadrotor
    ahead = np.maximum(direction @ way - slack, 0.0)
    pull = q.thrust_max - sign * q.gravity * direction[:, 1]
    return float(((np.sqrt(speed**2 + 2 * pull * ahead) - speed) / pull).max())


def _directions() -> Array:
    angle = np.linspace(0.0, 2 * np.pi, DIRECTIONS, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


@lru_cache(maxsize=256)
def projection_bound(scenario: Scenario, tolerance: Tolerance | None = None) -> float:
    """Return a time [s] that no flight from start to goal can beat; computed once for each task.

    Args:
        scenario: the task; only its displacement and its vehicle's thrust and gravity are used.
        tolerance: at the goal; None means exactly at rest.
    """
    direction = _directions()
    slack, speed = (0.0, 0.0) if tolerance is None else (tolerance.position, tolerance.speed)
    q = scenario.quadrotor
    way = direction @ (np.array(scenario.goal) - scenario.start) - slack
    forward, backward = q.thrust_max - q.gravity * direction[:, 1], q.thrust_max + q.gravity * direction[:, 1]
    way, forward, backward = way[way > 0], forward[way > 0], backward[way > 0]
    if not way.size:
        return 0.0
    peak = np.sqrt((2 * way + speed**2 / backward) * forward * backward / (forward + backward))
    # On a way too short to reach the arrival speed the vehicle never brakes.
    time = np.where(peak > speed, peak / forward + (peak - speed) / backward, np.sqrt(2 * way / forward))
    return float(time.max())
