"""Path following, paper eq. (8): the path is given, and its time law is optimised.

    minimise    T = integral of ds / sqrt(b)
    subject to  b > 0,  states and inputs within their limits.

This is eq. (10) with a single outer path, and is solved as such (`optimal.flat.planning`). On a regular curve
(y' nowhere zero) a motion from rest needs b = 0 at the ends, where T is infinite for systems of third order
(section II-E). A regular curve is therefore reparametrised as y(q(s)), where q is a smoothstep whose derivatives
below the order of the system vanish at both ends. The geometric path is unchanged.
"""

from __future__ import annotations

import numpy as np

from flatgym.quadrotor import Quadrotor
from optimal.flat.planning import pose
from optimal.flat.refinement import INTERVALS, optimise
from optimal.flat.solution import FlatSolution
from optimal.paths.curves import Path, Resting
from optimal.paths.regularity import require_regular
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
        path: answers `path(s, order)` for s in [0, 1], with as many continuous derivatives as the order of the
            system; regular (y' nowhere zero), or at rest at both ends and regular between.
        system: the flat system with its limits; a planar quadrotor by default.
        checks: "certified" or "nodes", as in `optimal.plan`.
        intervals: intervals of the first grid, at least 4.

    Returns:
        The solution. If the solve fails, its time is inf and its status gives the reason.

    Raises:
        ValueError: for a path that stands still between its ends, or has the wrong number of coordinates.

    Source: eq. (8), in the corrected form of `optimal.flat.trajectory`.
    """
    system = PlanarQuadrotor(system or Quadrotor()) if not isinstance(system, FlatSystem) else system
    require_regular(path)
    at_rest = all(np.abs(path(s, 1)).max() <= 1e-9 for s in (0.0, 1.0))
    followed = path if at_rest else Resting(path, system.order)
    return optimise(pose([followed], system, None, "explicit" if at_rest else "implicit", checks), intervals)
