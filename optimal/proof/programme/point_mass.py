"""Pairs of passing times that a chain need not consider, because not even a point mass passes them.

A point mass turns its thrust at once. For the weight q its greatest reward is thrust_max |q| - g q_z, for any tilt.
With the interpolation error of the tilt programme, the mean of both programmes over a segment is at most the sum of

    dt ((thrust_max + bulge) |q| - g q_z),   halved at both ends of the segment,

and the penalties are at most 0. The part (0, h) that all segments share is split off, |q| <= |q - (0, h)| + |h|. The
rest depends on the duration of a segment only, so that all pairs of passing times are bounded at little cost. The best
values up to a passing, and from the next one on, follow from a dynamic programme without tilts.

A pair is left out if the best chain of a point mass through it, with what all chains share, is below minus the bound of
the rounding error. All chains through it are then negative. The theorem of the chain and its pruning ask no more of
them: for given passing times, both programmes have the same weight, and their mean is at most that of the point mass.
"""

from __future__ import annotations

import math

import numpy as np

from flatgym.kernels.compilation import cached
from optimal.proof.programme.chain import constants, next_instants, slope


@cached(error_model="numpy", nogil=True)
def pairs_left(chain, limits, least):  # type: ignore[no-untyped-def]
    """Return which pairs of instants of consecutive stations are left, as `Chain.left`.

    Args:
        chain: the terms of all chains.
        limits: of the programme.
        least: the value below which a chain is left out.
    """
    stations, shape = chain.weights.shape[0], chain.left.shape
    shared, best = _shared_rewards(chain, limits), np.full(shape, -np.inf)
    before, after = np.full(shape[:2], -np.inf), np.full((stations, shape[1]), -np.inf)
    before[0, 0] = after[stations - 1, 0] = 0.0
    for i in range(stations - 1):
        (first, last), stride = chain.windows[i], chain.stride
        table = _rewards(chain, limits, i)
        for k0 in range(first, last + 1, stride):
            at_0 = (k0 - first) // stride
            for k1 in next_instants(chain, i, k0):
                at_1 = (k1 - chain.windows[i + 1, 0]) // stride
                value = table[(k1 - k0) // stride] + shared[k1] - shared[k0]
                best[i, at_0, at_1] = value
                if i < stations - 2:
                    before[i + 1, at_1] = max(before[i + 1, at_1], before[i, at_0] + value)
    left = np.zeros(shape, np.bool_)
    for i in range(stations - 2, -1, -1):
        for a in range(shape[1]):
            for b in range(shape[2]):
                value = best[i, a, b] + after[i + 1, b]
                after[i, a] = max(after[i, a], value)
                left[i, a, b] = before[i, a] + value >= least
    return left


@cached(error_model="numpy")
def _shared_rewards(chain, limits):  # type: ignore[no-untyped-def]
    """Return the rewards of the weight (0, h) from the first instant to each, shape (N+1,)."""
    count = chain.common.shape[0]
    found, up = np.zeros(count), limits.thrust_max + limits.bulge
    for k in range(1, count):
        one, other = chain.common[k - 1, 1], chain.common[k, 1]
        found[k] = found[k - 1] + limits.dt / 2 * (up * (abs(one) + abs(other)) - limits.gravity * (one + other))
    return found


@cached(error_model="numpy")
def _rewards(chain, limits, i):  # type: ignore[no-untyped-def]
    """Return the value of segment i without (0, h) for each duration in strides, with the best ends of both gaps."""
    stride, count, dt, begin = chain.stride, chain.common.shape[0] - 1, limits.dt, np.int64(0)
    shortest = max(chain.windows[i + 1, 0] - chain.windows[i, 1], chain.durations[i, 0], stride)
    longest = min(chain.windows[i + 1, 1] - chain.windows[i, 0], chain.durations[i, 1])
    table, up = np.full(count // stride + 1, -np.inf), limits.thrust_max + limits.bulge
    (x, z), (w_x, w_z) = chain.weights[i], chain.weights[i + 1] - chain.weights[i]
    for length in range(shortest, longest + 1, stride):
        total = 0.0
        for k in range(length + 1):
            q_x, q_z = x + w_x * k / length, z + w_z * k / length
            reward = up * math.sqrt(q_x * q_x + q_z * q_z) - limits.gravity * q_z
            total += reward if 0 < k < length else reward / 2
        s_x, s_z = slope(chain, i, begin, length, dt)
        total = dt * total + constants(chain, i, begin, length, s_x, s_z)
        to, since = -np.inf, -np.inf
        for end in range(2):
            to = max(to, s_x * chain.places[i + 1, end, 0] + s_z * chain.places[i + 1, end, 1])
            since = max(since, -s_x * chain.places[i, end, 0] - s_z * chain.places[i, end, 1])
        # The constants have the place of the last station already.
        table[length // stride] = total + since + (to if i < chain.weights.shape[0] - 2 else 0.0)
    return table
