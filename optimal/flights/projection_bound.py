"""Lower bounds on the flight time: no trajectory whatever is faster.

Project the flight on a unit vector d. Whatever the tilt, the acceleration along d lies between
-(thrust_max + g d_z) and thrust_max - g d_z, so the vehicle is at best a double integrator on a
line, and to cover D . d from rest, arriving at speed v_e or less, it needs at least

    T = v/a1 + (v - v_e)/a2,   v^2 = (2 D.d + v_e^2/a2) a1 a2 / (a1 + a2),

with a1 = thrust_max - g d_z and a2 = thrust_max + g d_z. Every d gives a valid bound, so the
largest over any set of directions is one. Rates, hoops and heights are left out, which can only
lower it: a short argument that anyone can check, though not a tight one.
"""

from __future__ import annotations

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario, Tolerance

DIRECTIONS = 7200


def passing_windows(
    scenario: Scenario, duration: float, tolerance: Tolerance | None = None
) -> list[tuple[float, float]]:
    """Return between which shares of a flight each hoop is passed, by the same argument, in any flight not longer.

    Before a hoop the vehicle comes from rest, t = sqrt(2 D.d / a1) at best, and after it it must come to rest, or
    to v_e.

    Args:
        scenario: the task.
        duration: the longest flight in question [s].
        tolerance: what counts as arrived; None means exactly at rest at the goal.
    """
    slack, speed = (0.0, 0.0) if tolerance is None else (tolerance.position, tolerance.speed)
    before, after = [], []
    for hoop in scenario.hoops:
        gap = hoop.half_gap(scenario.quadrotor.radius)
        before.append(_spurt(scenario, hoop.centre - scenario.start, gap, 0.0, 1))
        after.append(_spurt(scenario, scenario.goal - hoop.centre, gap + slack, speed, -1))
    earliest = np.maximum.accumulate(before) / duration
    latest = 1 - np.maximum.accumulate(after[::-1])[::-1] / duration
    return list(zip(earliest.tolist(), latest.tolist(), strict=True))


def _spurt(scenario: Scenario, way: Array, slack: float, speed: float, sign: int) -> float:
    """Return the least time [s] to cover a way but for `slack`, with one end at most so fast; sign -1 brakes."""
    direction, q = _directions(), scenario.quadrotor
    ahead = np.maximum(direction @ way - slack, 0.0)
    pull = q.thrust_max - sign * q.gravity * direction[:, 1]
    return float(((np.sqrt(speed**2 + 2 * pull * ahead) - speed) / pull).max())


def _directions() -> Array:
    angle = np.linspace(0.0, 2 * np.pi, DIRECTIONS, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def projection_bound(scenario: Scenario, tolerance: Tolerance | None = None) -> float:
    """Return a time [s] that no flight from start to goal can beat.

    Args:
        scenario: the task; only its displacement and its vehicle's thrust and gravity count.
        tolerance: what counts as arrived; None means exactly at rest at the goal.
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
    # Where the way is too short to reach the arrival speed, it never brakes.
    time = np.where(peak > speed, peak / forward + (peak - speed) / backward, np.sqrt(2 * way / forward))
    return float(time.max())
