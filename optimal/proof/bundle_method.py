"""Multipliers that show a time to be impossible: the origin separated from a convex set.

F(y) = max over g in G of g . y is convex and positively homogeneous, and what is wanted is a y with F(y) < 0, that
is, a plane between the origin and the convex set G of which only supporting planes can be asked for. A bundle
method (Lemarechal 1975) keeps the subgradients g_i found so far and steps from the best point c to

    the least  max over i of g_i . y + |y - c|^2 / (2 s),  y_j >= 0 where the sign is given,

whose dual asks for the point closest to c/s among the convex combinations of the g_i less a cone: one nonnegative least
squares problem (Lawson and Hanson 1974). If that holds the origin itself among the combinations, no y will do.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from flatgym.quadrotor import Array
from optimal.proof.dual import Dual

STEPS = 40
"""Most points at which F is asked for."""
WEIGHT = 1e3
"""Weight of the equation that the shares of the subgradients add up to one."""
NOTHING = 1e-6
"""A combination of subgradients this short, relative to their greatest length, is the origin."""


class Separation(NamedTuple):
    """What `separate` found.

    Attributes:
        multipliers: the best point, of length 1.
        value: F there, a proven bound: rounding is added.
        evaluations: how often F was asked for.
    """

    multipliers: Array
    value: float
    evaluations: int


def separate(dual: Dual, start: Array, steps: int = STEPS) -> Separation:
    """Look for multipliers with F < 0.

    Args:
        dual: F.
        start: multipliers to begin with, shape (dual.size,), not zero.
        steps: how often F may be asked for.
    """
    cone = np.eye(dual.size)[dual.signed].T
    slopes = np.zeros((dual.size, 0))
    point, best, centre, length, evaluations = start, np.inf, start, 1.0, 0
    while evaluations < steps:
        evaluations += 1
        point = point / np.linalg.norm(point)
        cuts = dual(point)
        slopes = np.hstack([slopes, np.array([cut.slope for cut in cuts]).T])
        value = max(cut.value + cut.rounding for cut in cuts)
        length *= 2 if value < best else 0.5
        if value < best:
            best, centre = value, point
        if best < 0 or _holds_origin(slopes, cone):
            break
        point = centre - length * _nearest(slopes, cone, centre / length)
        point[dual.signed] = np.maximum(point[dual.signed], 0.0)
        if not np.linalg.norm(point) > NOTHING:
            break
    return Separation(centre, float(best), evaluations)


def _holds_origin(slopes: Array, cone: Array) -> bool:
    """Return whether some combination of subgradients is nothing, so that F >= 0 everywhere."""
    origin = np.zeros(len(slopes))
    return bool(np.linalg.norm(_nearest(slopes, cone, origin)) <= NOTHING * np.abs(slopes).max())


def _nearest(slopes: Array, cone: Array, target: Array) -> Array:
    """Return the combination of columns of `slopes`, less some of `cone`, closest to a target, shape (n,)."""
    count, scale = slopes.shape[1], max(1.0, float(np.abs(target).max()))
    columns = np.hstack([slopes, -cone])
    sums = WEIGHT * scale * np.append(np.ones(count), np.zeros(cone.shape[1]))
    shares, _ = nnls(np.vstack([columns, sums]), np.append(target, WEIGHT * scale), maxiter=50 * len(sums))
    return np.asarray(columns @ shares)
