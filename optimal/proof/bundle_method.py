"""Multipliers that exclude a time, as a hyperplane that separates the origin from a convex set.

F(y) = max over g in G of g . y is convex and positively homogeneous. A y with F(y) < 0 is sought, which is a plane
between the origin and the convex set G. G is known only through its supporting planes. A bundle method (Lemarechal
1975) stores the subgradients g_i of all evaluations and steps from the best point c to

    the minimum over y of  max over i of g_i . y + |y - c|^2 / (2 s),  with y_j >= 0 for the signed multipliers.

Its dual is the projection of c/s onto the convex combinations of the g_i minus a cone, which is one nonnegative
least-squares problem (Lawson and Hanson 1974). If the origin is such a combination itself, no y has F(y) < 0.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from flatgym.quadrotor import Array
from optimal.proof.dual import Dual

MAX_EVALUATIONS = 40
"""Most evaluations of F."""
SUM_WEIGHT = 1e3
"""Least-squares weight of the equation that the coefficients of the subgradients sum to one."""
ZERO_LENGTH = 1e-6
"""A combination of subgradients up to this length, relative to the greatest component of all, counts as the origin."""


class Separation(NamedTuple):
    """The result of `separate`.

    Attributes:
        multipliers: the best point, of length 1.
        value: F at that point, a proven bound that includes the rounding error.
        evaluations: number of evaluations of F.
    """

    multipliers: Array
    value: float
    evaluations: int


def separate(
    dual: Dual, start: Array, max_evaluations: int = MAX_EVALUATIONS, deadline: float = math.inf
) -> Separation:
    """Search for multipliers with F < 0.

    Args:
        dual: F.
        start: initial multipliers, nonzero, shape (dual.size,).
        max_evaluations: most evaluations of F; at least one.
        deadline: when to stop, on the clock of `time.monotonic` [s].
    """
    cone = np.eye(dual.size)[dual.signed].T
    slopes = np.zeros((dual.size, 0))
    point, best, centre, length, evaluations = start, np.inf, start, 1.0, 0
    while evaluations < max_evaluations and (evaluations == 0 or time.monotonic() < deadline):
        evaluations += 1
        point = point / np.linalg.norm(point)
        cut = dual(point)
        slopes = np.column_stack([slopes, cut.slope])
        value = cut.value + cut.rounding
        length *= 2 if value < best else 0.5
        if value < best:
            best, centre = value, point
        if best < 0 or _contains_origin(slopes, cone):
            break
        point = centre - length * _projection(slopes, cone, centre / length)
        point[dual.signed] = np.maximum(point[dual.signed], 0.0)
        if not np.linalg.norm(point) > ZERO_LENGTH:
            break
    return Separation(centre, float(best), evaluations)


def _contains_origin(slopes: Array, cone: Array) -> bool:
    """Return whether the origin is a convex combination of subgradients minus the cone, which implies F >= 0."""
    origin = np.zeros(len(slopes))
    return bool(np.linalg.norm(_projection(slopes, cone, origin)) <= ZERO_LENGTH * np.abs(slopes).max())


def _projection(slopes: Array, cone: Array, target: Array) -> Array:
    """Return the projection of a target onto the convex combinations of `slopes` minus the cone, shape (n,)."""
    count, scale = slopes.shape[1], max(1.0, float(np.abs(target).max()))
    columns = np.hstack([slopes, -cone])
    sums = SUM_WEIGHT * scale * np.append(np.ones(count), np.zeros(cone.shape[1]))
    shares, _ = nnls(np.vstack([columns, sums]), np.append(target, SUM_WEIGHT * scale), maxiter=50 * len(sums))
    return np.asarray(columns @ shares)
