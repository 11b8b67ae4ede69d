"""Limits of a motion in continuous time: their violation, and uniform time scaling to keep them.

The violation of a limit is relative to the scale of the limit (`FlatSystem.bounds`). It is sampled between
nodes. For the planar quadrotor it is also bounded rigorously by the Bernstein bounds of `optimal.flat.bounds`.

Uniform time scaling travels the same path slower by a constant factor c: b is divided by c^2, and the k-th time
derivative by c^k.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import BSpline

from flatgym.quadrotor import Array
from optimal.flat.trajectory import SAMPLES, FlatTrajectory
from optimal.systems import FlatSystem

LOCAL_SAMPLES = 8
"""Points on either side of the largest sampled violation at which it is evaluated again."""
SPEED_UP = 1.02
"""Factor of one speed-up step."""
LEAST_RATE, MOST_RATE = 0.1, 3.0
"""Least and greatest decrease of a violation per relative slow-down. Where gravity is small beside the acceleration a
thrust falls twice as fast as the speed."""


def interval_violations(flight: FlatTrajectory) -> Array:
    """Return the violation of each limit on each interval, in continuous time.

    Maxima are searched among samples of every interval and again around the largest sample. Both sides of a
    node are sampled with their own highest derivatives.

    Returns:
        Shape (2, limits, N): violations of the greatest, then of the least values; negative where the limit
        holds with slack, inf where the quantity is undefined.
    """
    system, nodes = flight.system, flight.nodes
    s = flight.interval_points(SAMPLES)
    coarse = _violations(system, flight.jet(s))
    largest = coarse.max(axis=-1)
    step = np.diff(nodes)[:, None] / SAMPLES * np.linspace(-1, 1, 2 * LOCAL_SAMPLES + 1)
    top = np.take_along_axis(np.broadcast_to(s, coarse.shape), coarse.argmax(axis=-1)[..., None], axis=-1)
    near = _violations(system, flight.jet(np.clip(top + step, s[:, :1], s[:, -1:])))
    for side, limit in np.ndindex(largest.shape[:2]):
        closer = near[side, limit, side, limit].max(axis=-1)
        largest[side, limit] = np.maximum(largest[side, limit], closer)
    return largest


def constraint_violation(flight: FlatTrajectory) -> float:
    """Return the largest sampled violation of a limit, relative to its scale, at least 0."""
    return max(0.0, float(interval_violations(flight).max(initial=0.0)))


def proven_violation(flight: FlatTrajectory) -> float:
    """Return a proven upper bound of the violation, at least 0.

    Returns 0 where no bound is proven, which leaves the sampled violation as the only estimate.
    """
    bounds = flight.control_range()
    if not np.isfinite(bounds).all():
        return 0.0
    q = flight.quadrotor
    return max(0.0, float((np.maximum(q.control_low - bounds[0], bounds[1] - q.control_high) / q.control_high).max()))


def scaled(flight: FlatTrajectory, factor: float) -> FlatTrajectory:
    """Return the motion along the same path that takes `factor` times as long."""
    b = flight.squared_speed
    return replace(flight, squared_speed=BSpline(b.t, b.c * factor**-2, b.k))


def slowed_to_limits(flight: FlatTrajectory, max_factor: float) -> FlatTrajectory | None:
    """Return the fastest uniform slow-down of a motion that keeps all limits.

    Args:
        flight: the motion.
        max_factor: the greatest scaling factor c to try.

    Returns:
        The scaled motion; None where `max_factor` does not suffice.
    """
    jet = flight.jet(flight.interval_points(2 * SAMPLES))
    factor, step, rate, before = 1.0, 0.0, MOST_RATE, 0.0
    while factor <= max_factor:
        slower = scaled(flight, factor)
        sampled = float(_violations(flight.system, [y / factor**k for k, y in enumerate(jet)]).max(initial=0.0))
        violation = sampled or constraint_violation(slower) or proven_violation(slower)
        if violation == 0:
            return slower
        if 0 < before <= sampled:  # a limit that a slower motion does not keep better
            return None
        if violation < before:
            rate = min(max((before - violation) / step, LEAST_RATE), MOST_RATE)
        before, step = violation, 1.01 * violation / rate + 1e-9
        factor *= 1 + step
    return None


def sped_up_to_limits(flight: FlatTrajectory) -> FlatTrajectory | None:
    """Return the motion sped up in steps of SPEED_UP until a limit is active; None if it violates one already."""
    feasible, faster = None, flight
    while constraint_violation(faster) == 0:
        feasible, faster = faster, scaled(faster, 1 / SPEED_UP)
    return feasible and slowed_to_limits(feasible, SPEED_UP)


def _violations(system: FlatSystem, jet: list[Array]) -> Array:
    """Return the violations of greatest and least values, shape (2, limits, ...)."""
    _, _, low, high = system.bounds
    # The rate is undefined where the thrust vanishes.
    values = np.nan_to_num(system.limited_values(jet), nan=np.inf)
    return np.moveaxis(np.stack([values - high, low - values]), -1, 1)
