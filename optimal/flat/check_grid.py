"""The grid of the flat method: spline spaces of the unknowns, and the checks at which limits are imposed.

Each of the N intervals has equidistant checks, both ends included. Neighbouring intervals share the check
at their common node.
"""

from __future__ import annotations

import numpy as np

from flatgym.quadrotor import Array
from optimal.flat.splines import SplineSpace
from optimal.systems import FlatSystem

CHECKS = 5
"""Checks per interval, both ends included. With fewer, solutions violate limits between the checks."""


def spaces(system: FlatSystem, nodes: Array, certified: bool) -> tuple[SplineSpace, SplineSpace]:
    """Return the spline spaces of the weights and of the squared speed."""
    more = int(certified)
    return SplineSpace(nodes, system.order + more, 1 + more), SplineSpace(nodes, system.order - 1 + more, 1 + more)


def local_sizes(system: FlatSystem, certified: bool) -> tuple[int, int]:
    """Return how many coefficients of one weight and of b are active on an interval."""
    weights, speed = spaces(system, np.array([0.0, 1.0]), certified)
    return weights.degree + 1, speed.degree + 1


def checks_per_interval(certified: bool) -> int:
    """Return the number of checks of an interval, both ends included."""
    return CHECKS if certified else 2


def check_points(nodes: Array, certified: bool) -> Array:
    """Return the path coordinates of the checks of each interval, shape (N, checks)."""
    share = np.linspace(0.0, 1.0, checks_per_interval(certified))
    return nodes[:-1, None] + np.diff(nodes)[:, None] * share


def shared_points(nodes: Array, certified: bool) -> Array:
    """Return the path coordinates of all checks in increasing order, shared checks once, shape (checks,)."""
    return np.append(check_points(nodes, certified)[:, :-1].ravel(), nodes[-1])
