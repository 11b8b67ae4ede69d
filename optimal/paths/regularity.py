"""Regular paths: y' vanishes at the ends at most."""

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


def require_regular(path: Path) -> None:
    """Refuse a path that stands still inside (0, 1), where its direction and eq. (6) are undefined.

    Args:
        path: the path; y' = 0 at its ends is allowed.

    Raises:
        ValueError: naming the s at which y' vanishes or is not finite.
    """

    def speed(s: ArrayLike) -> Array:
        return np.linalg.norm(path(s, 1), axis=-1)

    s = np.linspace(0.0, 1.0, REGULARITY_SAMPLES + 1)
    speeds = speed(s)
    if not np.isfinite(speeds).all():
        raise ValueError(f"the path's derivative is not finite at s = {s[~np.isfinite(speeds)][0]:.4g}")
    least = STANDSTILL * speeds.max()
    # y' can vanish between two samples only if it changes by its own length from one to the next.
    change = np.linalg.norm(path(s, 2), axis=-1) / REGULARITY_SAMPLES
    suspect = speeds[1:-1] <= np.maximum(np.max([change[:-2], change[1:-1], change[2:]], axis=0), least)
    for i in np.flatnonzero(suspect & (speeds[1:-1] <= speeds[:-2]) & (speeds[1:-1] <= speeds[2:])) + 1:
        minimum = minimize_scalar(speed, bounds=(s[i - 1], s[i + 1]), method="bounded", options={"xatol": 1e-12})
        if min(minimum.fun, speeds[i]) <= least:
            at = s[i] if speeds[i] <= minimum.fun else minimum.x
            raise ValueError(
                f"the path is degenerate: its derivative vanishes at s = {at:.4g}, inside (0, 1), where the path then "
                "has no direction; a path may stand still at its ends only"
            )
