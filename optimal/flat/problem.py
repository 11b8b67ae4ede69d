"""The planning problem of eq. (10), a point of its nonlinear program, and the trust region around a point.

These values pass between the stages of the flat method. A `PlanningProblem` does not depend on a grid.
An `Iterate` holds the unknowns of the program on one grid. A `TrustRegion` limits how far a solve may
move them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from flatgym.quadrotor import Array
from optimal.flat.splines import SplineSpace
from optimal.paths.curves import Path
from optimal.systems import FlatSystem

CHECKS = 5
"""Checks per interval, both ends included. With fewer, solutions violate limits between the checks."""


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """Eq. (10), independent of the grid.

    Attributes:
        system: the flat system, with its limits.
        outer_paths: k >= 1 outer paths y_i(s).
        ends: the weights of all outer paths at s = 0 and s = 1, shape (2, k).
        certified: True: limits are imposed at all checks of an interval. False: at grid nodes only, as published.
        level: number of derivatives of the weights that vanish at both ends.
        speed_unit: unit of the squared speed b in the program [1/s^2]. The program is then much the same for a path of
            a millimetre and one of kilometres, which keeps the tolerances of the optimiser meaningful.
    """

    system: FlatSystem
    outer_paths: tuple[Path, ...]
    ends: Array
    certified: bool
    level: int
    speed_unit: float = 1.0


@dataclass(frozen=True)
class TrustRegion:
    """How far the unknowns of a program may move from the start of the solve.

    Other local solutions exist nearby, for example with an additional flip between two checks. After a
    mesh refinement or a tightening of limits, the trust region keeps the solver from jumping to one.

    Attributes:
        weights: bound for the coefficients of the weights.
        speed: bound for the coefficients of the squared speed, relative to their values.
        attitude: bound for lifted unknowns without limits of their own [rad].
    """

    weights: float
    speed: float
    attitude: float

    def scaled(self, factor: float) -> TrustRegion:
        """Return the trust region with all bounds multiplied by a factor."""
        return TrustRegion(self.weights * factor, self.speed * factor, self.attitude * factor)


UNBOUNDED, FIXED_PATH = TrustRegion(math.inf, math.inf, math.inf), TrustRegion(0.0, math.inf, math.inf)
LARGE_REGION, SMALL_REGION = TrustRegion(0.1, 0.5, 0.5), TrustRegion(0.005, 0.03, 0.03)


@dataclass(frozen=True, eq=False)
class Iterate:
    """The unknowns of the program on one grid.

    Attributes:
        nodes: grid nodes, shape (N + 1,).
        weights: coefficients of the first k - 1 weights, shape (size, k - 1).
        squared_speed: coefficients of b [speed_unit], shape (size,).
        lifted: the lifted unknowns at the checks, one row for a check shared by two intervals, shape (checks, lifted).
        multipliers: Ipopt's multipliers of the bounds and of the constraints; None before the first solve.
        outcome: Ipopt's return status.
        iterations: Ipopt iterations of all solves that led here.
    """

    nodes: Array
    weights: Array
    squared_speed: Array
    lifted: Array
    multipliers: tuple[Any, Any] | None = None
    outcome: str = "not solved yet"
    iterations: int = 0


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
