"""Paths that a system can follow: smooth enough for its order, with a direction everywhere between their ends.

A system of order beta moves along y(s) only if y and its derivatives up to order beta - 1 are continuous. A jump of
y' is a corner, where the velocity jumps. A jump is found without knowledge of the knots: over a short interval,

    y^(k)(s + h) - y^(k)(s) = integral of y^(k+1) ds,

but for the error of the quadrature, which vanishes with h, and for jumps within the interval, which do not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from flatgym.quadrotor import Array
from optimal.paths.curves import Path

REGULARITY_SAMPLES = 2000
"""Number of intervals on which `require_regular` searches for points where a path stands still."""
STANDSTILL = 1e-6
"""|y'| that counts as zero, relative to the largest one of the path."""
JUMP, ROUNDING = 1e-8, 1e-12
"""Jump of a derivative that counts as rounding: relative to the largest derivative up to its order, at least the first;
relative to the largest value of its own."""
BISECTIONS = 40
"""Bisections of an interval that may contain a jump."""
QUADRATURE = np.polynomial.legendre.leggauss(3)


class StandstillError(ValueError):
    """A path stands still between its ends."""


def require_smooth(path: Path, order: int, name: str = "the path") -> None:
    """Refuse a path whose derivatives up to order - 1 are not continuous, at knots or elsewhere.

    Args:
        path: the path, with values between knots for derivatives up to `order`.
        order: beta, the order of the system.
        name: the path's name in the error.

    Raises:
        ValueError: naming the s of the largest jump.
    """
    s = np.linspace(0.0, 1.0, REGULARITY_SAMPLES + 1)
    sizes = [np.abs(path(s, k)).max() for k in range(order + 1)]
    for k in range(order):
        rounding = max(JUMP * max(sizes[1 : k + 1], default=sizes[1]), ROUNDING * sizes[k])
        suspect = ~(_jumps(path, k, s[:-1], s[1:]) <= rounding)
        begin, end = s[:-1][suspect], s[1:][suspect]
        for _ in range(BISECTIONS):
            middle = (begin + end) / 2
            left = _jumps(path, k, begin, middle) > _jumps(path, k, middle, end)
            begin, end = np.where(left, begin, middle), np.where(left, middle, end)
        jumps = _jumps(path, k, begin, end)
        if not (jumps <= rounding).all():
            worst = int(np.argmax(jumps))
            raise ValueError(
                f"{name} is not smooth at s = {end[worst]:.4g}: its derivative of order {k} jumps by {jumps[worst]:.3g}"
                f" there, but a system of order {order} needs continuous derivatives up to order {order - 1}; round "
                "the path there, or divide it there and stop"
            )


def _jumps(path: Path, order: int, begin: Array, end: Array) -> Array:
    """Return by how much a derivative changes over intervals beyond the integral of the next one, shape (n,)."""
    width = (end - begin)[:, None]
    rates = path(begin[:, None] + width * (QUADRATURE[0] + 1) / 2, order + 1)
    explained = width / 2 * np.einsum("j,ijk->ik", QUADRATURE[1], rates)
    return np.asarray(np.abs(path(end, order) - path(begin, order) - explained).max(axis=-1))


def require_regular(path: Path, name: str = "the path") -> None:
    """Refuse a path that stands still inside (0, 1), where its direction and eq. (6) are undefined.

    Args:
        path: the path; y' = 0 at its ends is allowed.
        name: the path's name in the error.

    Raises:
        StandstillError: naming the s at which y' vanishes.
        ValueError: naming the s at which y' is not finite.
    """

    def speed(s: ArrayLike) -> Array:
        return np.linalg.norm(path(s, 1), axis=-1)

    s = np.linspace(0.0, 1.0, REGULARITY_SAMPLES + 1)
    speeds = speed(s)
    if not np.isfinite(speeds).all():
        raise ValueError(f"the derivative of {name} is not finite at s = {s[~np.isfinite(speeds)][0]:.4g}")
    least = STANDSTILL * speeds.max()
    # y' can vanish between two samples only if it changes by its own length from one to the next.
    change = np.linalg.norm(path(s, 2), axis=-1) / REGULARITY_SAMPLES
    suspect = speeds[1:-1] <= np.maximum(np.max([change[:-2], change[1:-1], change[2:]], axis=0), least)
    for i in np.flatnonzero(suspect & (speeds[1:-1] <= speeds[:-2]) & (speeds[1:-1] <= speeds[2:])) + 1:
        minimum = minimize_scalar(speed, bounds=(s[i - 1], s[i + 1]), method="bounded", options={"xatol": 1e-12})
        if min(minimum.fun, speeds[i]) <= least:
            at = s[i] if speeds[i] <= minimum.fun else minimum.x
            raise StandstillError(
                f"{name} is degenerate: its derivative vanishes at s = {at:.4g}, inside (0, 1), where the path then "
                "has no direction; a path may stand still at its ends only"
            )
