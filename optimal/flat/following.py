"""Path following, paper eq. (8): the path is given, and only how fast to travel it is not.

    minimise    T = integral of ds / sqrt(b)
    subject to  b > 0,  states and inputs within their limits.

This is eq. (10) with a single outer path, and solved as that (`optimal.flat.planning`). A regular curve
(y' nowhere zero) cannot be left from rest with b > 0, and b = 0 would make T infinite for systems of
third order (section II-E); so it is run through as y(q(s)), with a smoothstep q whose derivatives
below the system's order vanish at both ends. The path flown is the same.
"""

from __future__ import annotations

import numpy as np

from flatgym.quadrotor import Quadrotor
from optimal.flat.planning import pose
from optimal.flat.refinement import INTERVALS, FlatSolution, optimise
from optimal.paths.curves import Path, Resting, require_regular
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
        path: answers `path(s, order)` for s in [0, 1], with as many continuous derivatives as the
            system's order has; regular (y' nowhere zero), or at rest at both ends and regular between.
        system: what moves, with its limits; a planar quadrotor by default.
        checks: "certified", or "nodes", as `optimal.plan` has it.
        intervals: pieces of b on the first grid.

    Returns:
        The solution; where the solve fails its time is inf and its status says why.

    Raises:
        ValueError: for a path that stands still on the way, or of the wrong number of coordinates.

    Source: eq. (8), in the corrected form of `optimal.flat.trajectory`.
    """
    system = PlanarQuadrotor(system or Quadrotor()) if not isinstance(system, FlatSystem) else system
    require_regular(path)
    at_rest = all(np.abs(path(s, 1)).max() <= 1e-9 for s in (0.0, 1.0))
    followed = path if at_rest else Resting(path, system.order)
    return optimise(pose([followed], system, None, "explicit" if at_rest else "implicit", checks), intervals)
