"""Path following, paper eq. (8): the path is given, and its time law is optimised.

    minimise    T = integral of ds / sqrt(b)
    subject to  b > 0,  states and inputs within their limits.

This is eq. (10) with a single outer path, and is solved as such (`optimal.flat.planning`). On a regular curve
(y' nowhere zero) a motion from rest needs b = 0 at the ends, where T is infinite for systems of third order
(section II-E). A curve is therefore reparametrised as y(q(s)), where q is the smoothstep of the least order with which
all derivatives below the order of the system vanish at both ends. The geometric path is unchanged.

A curve that begins like s^m (m = 1 if it is regular there, m = 2 with a doubled control point) and q, which begins like
s^n, give y(q(s)) like s^(m n): the least n is the order of the system divided by m, rounded up.
"""

from __future__ import annotations

import math

import numpy as np

from flatgym.quadrotor import Quadrotor
from optimal.flat.planning import pose
from optimal.flat.refinement import INTERVALS, optimise
from optimal.flat.solution import FlatSolution
from optimal.paths.curves import Path, Resting
from optimal.paths.regularity import STANDSTILL, require_regular, require_smooth
from optimal.systems import FlatSystem, PlanarQuadrotor


def follow(
    path: Path,
    system: FlatSystem | Quadrotor | None = None,
    *,
    checks: str = "certified",
    intervals: int = INTERVALS,
) -> FlatSolution:
    """Return the fastest motion along a path, from rest to rest.

    Args:
        path: answers `path(s, order)` for s in [0, 1], with continuous derivatives below the order of the system;
            regular (y' nowhere zero) but for the ends.
        system: the flat system with its limits; a planar quadrotor by default.
        checks: "certified" or "nodes", as in `optimal.plan`.
        intervals: intervals of the first grid, at least 4.

    Returns:
        The solution. If the solve fails, its time is inf and its status gives the reason.

    Raises:
        ValueError: for a path that stands still between its ends, is not smooth enough for the system, or has the
            wrong number of coordinates.

    Source: eq. (8), in the corrected form of `optimal.flat.trajectory`.
    """
    system = PlanarQuadrotor(system or Quadrotor()) if not isinstance(system, FlatSystem) else system
    require_regular(path)
    require_smooth(path, system.order)
    least = min(leading_order(path, end, system.order) for end in (0.0, 1.0))
    rise = math.ceil(system.order / least)
    followed = path if rise == 1 else Resting(path, rise)
    return optimise(pose([followed], system, None, "implicit", checks), intervals)


def leading_order(path: Path, end: float, most: int) -> int:
    """Return the order of the first derivative of a path that does not vanish at an end; at most `most`."""
    scale = STANDSTILL * np.abs(path(np.linspace(0.0, 1.0, 101), 1)).max()
    return next((k for k in range(1, most) if np.abs(path(end, k)).max() > scale), most)
