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
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from flatgym.quadrotor import Array
from optimal.proof.dual import Dual
from optimal.proof.programme.rounding import LEAST_LENGTH

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
        impossible: whether the origin is a combination of subgradients, so that no multipliers have F < 0.
        chain: the chain with the greatest share in the combination that is closest to the origin, as in `Cut.chain`;
            of the last cut where F < 0.
        middle, spread: mean and standard deviation of its chains. They disagree most where a branch is best split.
    """

    multipliers: Array
    value: float
    evaluations: int
    impossible: bool
    chain: Array
    middle: Array
    spread: Array


def separate(
    dual: Dual, starts: Sequence[Array], max_evaluations: int = MAX_EVALUATIONS, deadline: float = math.inf
) -> Separation:
    """Search for multipliers with F < 0.

    Args:
        dual: F.
        starts: initial multipliers, nonzero, shape (dual.size,) each. The method continues from the best of them.
        max_evaluations: most evaluations of F; at least one.
        deadline: when to stop, on the clock of `time.monotonic` [s].
    """
    cone = np.eye(dual.size)[dual.signed].T
    slopes, chains = np.zeros((dual.size, 0)), list[Array]()
    best, centre, length, impossible, begun = np.inf, starts[0], 1.0, False, time.monotonic()
    points = list(starts)
    while len(chains) < max_evaluations:
        now = time.monotonic()
        if chains and now + (now - begun) / len(chains) > deadline:
            break
        point = points.pop(0)
        point = point / np.linalg.norm(point)
        cut = dual(point)
        slopes = np.column_stack([slopes, cut.slope])
        chains.append(cut.chain)
        value = cut.value + cut.rounding
        if len(chains) > len(starts):
            length *= 2 if value < best else 0.5
        if value < best:
            best, centre = value, point
        if best < 0:
            return Separation(centre, float(best), len(chains), False, cut.chain, cut.chain, np.zeros_like(cut.chain))
        impossible = _contains_origin(slopes, cone)
        if impossible:
            break
        if points:
            continue
        shares, rest = _shares(slopes, cone, centre / length)
        point = centre - length * (slopes @ shares - cone @ rest)
        point[dual.signed] = np.maximum(point[dual.signed], 0.0)
        if not np.linalg.norm(point) > ZERO_LENGTH:
            break
        points.append(point)
    shares = _shares(slopes, cone, np.zeros(dual.size))[0]
    heaviest = chains[int(np.argmax(shares))]
    return Separation(centre, float(best), len(chains), impossible, heaviest, *_disagreement(np.array(chains), shares))


def _contains_origin(slopes: Array, cone: Array) -> bool:
    """Return whether the origin is a convex combination of subgradients minus the cone, which implies F >= 0."""
    shares, rest = _shares(slopes, cone, np.zeros(len(slopes)))
    return bool(np.linalg.norm(slopes @ shares - cone @ rest) <= ZERO_LENGTH * np.abs(slopes).max())


def _shares(slopes: Array, cone: Array, target: Array) -> tuple[Array, Array]:
    """Return the convex combination of `slopes` minus the cone that is closest to a target, as shares of both."""
    count, scale = slopes.shape[1], max(1.0, float(np.abs(target).max()))
    columns = np.hstack([slopes, -cone])
    sums = SUM_WEIGHT * scale * np.append(np.ones(count), np.zeros(cone.shape[1]))
    shares, _ = nnls(np.vstack([columns, sums]), np.append(target, SUM_WEIGHT * scale), maxiter=50 * len(sums))
    return shares[:count], shares[count:]


def _disagreement(chains: Array, shares: Array) -> tuple[Array, Array]:
    """Return mean and standard deviation of the quantities of chains, shape (number of chains, n), by their shares."""
    shares = shares / max(float(shares.sum()), LEAST_LENGTH)
    middle = shares @ chains
    return middle, np.sqrt(np.maximum(shares @ (chains - middle) ** 2, 0.0))
