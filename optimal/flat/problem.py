"""TODO optimal/flat/problem.py."""

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
"""Checks per interval, both ends included; with fewer, flights are found that break limits between them."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be solved, on whatever grid.

    Attributes:
        system: what moves.
        outer_paths: k >= 1 paths.
        ends: weights of all of them at s = 0 and s = 1, shape (2, k).
        certified: whether limits hold at the checks of every interval, or at nodes only.
        level: how many derivatives of the weights vanish at both ends.
    """

    system: FlatSystem
    outer_paths: tuple[Path, ...]
    ends: Array
    certified: bool
    level: int


@dataclass(frozen=True)
class TrustRegion:
    """How far the unknowns of a program may move from its start.

    A program started from a solution has others around, some of which turn over between two checks;
    a finer grid or a tightened limit must not drive it there.

    Attributes:
        weights: the weights' coefficients.
        speed: the squared speed's, relatively.
        attitude: lifted unknowns without limits of their own [rad].
    """

    weights: float
    speed: float
    attitude: float

    def times(self, factor: float) -> TrustRegion:
        """Return the reach, scaled."""
        return TrustRegion(self.weights * factor, self.speed * factor, self.attitude * factor)


FREE, PATH_HELD = TrustRegion(math.inf, math.inf, math.inf), TrustRegion(0.0, math.inf, math.inf)
NEAR, CLOSE = TrustRegion(0.1, 0.5, 0.5), TrustRegion(0.02, 0.1, 0.1)


@dataclass(frozen=True, eq=False)
class Iterate:
    """A point of the program on its grid.

    Attributes:
        nodes: of the grid, shape (N + 1,).
        weights: coefficients of the first k - 1 weights, shape (size, k - 1).
        squared_speed: coefficients of b [1/s^2].
        lifted: the lifted unknowns at the checks, each shared by neighbours, shape (checks, lifted).
        multipliers: of the unknowns' bounds and of the constraints, as Ipopt gave them; None at first.
        outcome: how Ipopt ended.
        iterations: of Ipopt, over all programs that led here.
    """

    nodes: Array
    weights: Array
    squared_speed: Array
    lifted: Array
    multipliers: tuple[Any, Any] | None = None
    outcome: str = "not solved yet"
    iterations: int = 0


def spaces(system: FlatSystem, nodes: Array, certified: bool) -> tuple[SplineSpace, SplineSpace]:
    """Return the splines of the weights and of the squared speed."""
    more = int(certified)
    return SplineSpace(nodes, system.order + more, 1 + more), SplineSpace(nodes, system.order - 1 + more, 1 + more)


def local_sizes(system: FlatSystem, certified: bool) -> tuple[int, int]:
    """Return how many coefficients of one weight and of b matter on an interval."""
    weights, speed = spaces(system, np.array([0.0, 1.0]), certified)
    return weights.degree + 1, speed.degree + 1


def checks_per_interval(certified: bool) -> int:
    """Return the number of checks of an interval, both ends included."""
    return CHECKS if certified else 2


def check_points(nodes: Array, certified: bool) -> Array:
    """Return the coordinates of the checks of each interval, shape (N, checks)."""
    share = np.linspace(0.0, 1.0, checks_per_interval(certified))
    return nodes[:-1, None] + np.diff(nodes)[:, None] * share


def shared_points(nodes: Array, certified: bool) -> Array:
    """Return the coordinates of all checks, those that neighbours share once, increasing."""
    return np.append(check_points(nodes, certified)[:, :-1].ravel(), nodes[-1])
