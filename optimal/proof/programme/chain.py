"""The theorem of the chain: a bound for flights through any number of hoops, at unknown passing times.

The stations of a flight are its start, the hoops and its goal. It passes them at 0 = s_0 < s_1 < ... < s_(m+1) = T, at
places p_i relative to the start. Let S_i = s_i - s_(i-1). Each station has a vector lambda_i. Let
w_i = lambda_i - lambda_(i-1) and sigma_i = w_i/S_i. The weight q is linear from lambda_(i-1) to lambda_i on segment i,
plus (0, h), with h(t) = sum over j of sign_j kappa_j/T max(t - tau_j, 0) and kappa_j >= 0. The sign is + for kinks of
the floor and - for kinks of the ceiling.

Identity. Integrating by parts twice on each segment gives for every flight

    integral of q . a dt = q(T) . v(T) - sum over i of sigma_i . (p_i - p_(i-1)) - h'(T) z(T)
                           + sum over j of sign_j kappa_j/T z(tau_j).

The velocities at the hoops cancel because q is continuous. Floor and ceiling give sign_j z(tau_j) >= sign_j height_j.

Theorem. Let F be the maximum, over all chains, of the mean of two programmes. A chain consists of passing instants t_k,
one for each hoop and increasing, of one end of each gap, and of the tilts of `tilt_program`. Its value is
the sum over its segments of

    the value of the samples of the segment, as in the tilt programme, for the weight of the chain,
    + sigma_i . (p_i - p_(i-1)) + E_i,    E_i = n_i |w_i| (A/S + D/S^3) dt^2/4,    A = thrust_max + g,

plus position |sigma_(m+1) + h'(T) e_z| in the last segment, plus what all chains share: the penalty terms of the tilt
programme, h'(T) z_goal - sum of sign_j kappa_j/T height_j, and speed |q(T)|. Here n_i is the number of ends of the
segment that are hoops, D is the greatest distance between places of its stations, and S bounds from below the durations
of segments that pass within one time step of those of the chain. If F < 0, no flight takes the time T.

Proof. Suppose that a flight takes the time T, and move all terms of its identity to one side. They sum to at least 0
after the heights have been replaced. For given passing times, this sum is at most the value of the chain by the theorem
of the tilt programme, because q is linear between instants. Three steps remain.

Step 1 (places). The sum is linear in the places p_i. The ends of the gaps therefore suffice. The tolerance at the goal
adds the support function of its discs.

Step 2 (passing times). Fix the flight and its places, and let G(s) be the integral of q_s . a plus the sum of
sigma_i . (p_i - p_(i-1)), for any s. The boundary terms of dG/ds_i cancel because q is continuous. With the integrals
I of (t - s_(i-1)) a over segment i and J of (s_(i+1) - t) a over segment i+1, whose lengths are at most A S^2/2,

    d^2G/ds_i^2 = (sigma_(i+1) - sigma_i) . a(s_i) + 2 w_i . (I + p_i - p_(i-1))/S_i^3
                  + 2 w_(i+1) . (p_(i+1) - p_i - J)/S_(i+1)^3
                >= - sum over both segments of |w| (2 A/S + 2 D/S^3).

A function of one variable exceeds its chord over a cell of length dt by at most dt^2/8 times the greatest value of
minus its second derivative. The passing times are replaced by ends of their cells one after the other. G is therefore
at most its greatest value at the corners of the cells, plus dt^2/8 times these bounds, which are the E_i. All corners
are chains.

Step 3 (durations). If the segment of the flight ends in cells that begin at instants a and b, its corners are
k - k' = b - a - 1 to b - a + 1, and all durations met in step 2 are at least (b - a - 1) dt >= (k - k' - 2) dt. They
are also at least the least duration of the flight's segment minus 2 dt. It must be 4 dt or more. Hoops that are closer
are ignored, which is a relaxation. The least duration is what pruning or the windows of the first and last hoop left,
or the least distance of both stations divided by the greatest speed at which a flight passes there
(`optimal.flights.projection_bound`).

Cells. Hoops may be passed at every r-th instant only. The cells then last r dt, which replaces dt in the E_i and in
step 3.

Pruning. Let U be the value of the best chain up to a passing, W that of a segment, and V that of the best chain from
the next passing on. U is V of the problem reversed in time. If the mean over both programmes of max(U + W + V), plus
what all chains share, is negative at the four corners of two cells, no flight passes the two hoops within these cells,
by the same proof with both cells fixed. The cells that are left bound the passing times of both hoops, and the time
between them.

Pairs of passing times through which all chains are negative are left out (`point_mass`). Only where F is negative can
this lower it.

Rounding is bounded by `proof.chain_terms`.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatgym.kernels.compilation import cached
from flatgym.quadrotor import Array
from optimal.proof.programme.tilt_program import Integers, Tilts, best_neighbour, follow, sweep
from optimal.proof.programme.zero_order_hold import hold_follow, hold_sweep

Booleans = NDArray[np.bool_]
ALL_ROWS, TWO_ROWS = np.bool_(True), np.bool_(False)
"""Values of `keep` in `sweep`; a literal would be a type of its own, for which the callees are compiled again."""


class Chain(NamedTuple):
    """The terms of all chains for one set of multipliers; m + 2 stations, N time steps.

    Attributes:
        weights: lambda of each station, shape (m+2, 2).
        common: the part (0, h) of the weight at the instants, shape (N+1, 2).
        windows: first and last passing instant of each station, shape (m+2, 2).
        durations: least and greatest number of instants between consecutive stations, shape (m+1, 2).
        stride: hoops are passed at multiples of this number of instants.
        rows: row of the values at the first instant of each window, shape (m+2,).
        places: both ends of each gap, relative to the start, shape (m+2, 2, 2).
        curvature: E_i / |w_i| by segment and k - k' in cells, shape (m+1, N/stride + 1).
        goal: the segment with the tolerance at the goal.
        position: position tolerance [m].
        tail: h'(T).
        final: penalty of the last tilt, by position.
        left: whether chains may pass consecutive stations at a pair of instants, shape (m+1, n, n). The last two
            indices count the instants of each window in strides.
    """

    weights: Array
    common: Array
    windows: Integers
    durations: Integers
    stride: int
    rows: Integers
    places: Array
    curvature: Array
    goal: int
    position: float
    tail: float
    final: Array
    left: Booleans


def reverse_time(chain: Chain, tilts: Tilts, first: Array) -> tuple[Chain, Tilts]:
    """Return the problem reversed in time. The penalty of the first tilt, by position, becomes that of the last."""
    steps = len(chain.common) - 1
    windows = np.ascontiguousarray(steps - chain.windows[::-1, ::-1])
    backward = Chain(
        weights=chain.weights[::-1].copy(),
        common=chain.common[::-1].copy(),
        windows=windows,
        durations=chain.durations[::-1].copy(),
        stride=chain.stride,
        rows=first_rows(windows, chain.stride),
        places=chain.places[::-1].copy(),
        curvature=chain.curvature[::-1].copy(),
        goal=len(chain.weights) - 2 - chain.goal,
        position=chain.position,
        tail=-chain.tail,
        final=first,
        left=_reverse_pairs(chain),
    )
    return backward, tilts._replace(low=tilts.low[::-1].copy(), high=tilts.high[::-1].copy())


def _reverse_pairs(chain: Chain) -> Booleans:
    """Return `Chain.left` for the problem reversed in time."""
    found, counts = np.zeros_like(chain.left), (chain.windows[:, 1] - chain.windows[:, 0]) // chain.stride + 1
    for i, (a, b) in enumerate(pairwise(counts)):
        found[-1 - i, :b, :a] = chain.left[i, :a, :b][::-1, ::-1].T
    return found


@cached(error_model="numpy")
def is_left(chain, i, k0, k1):  # type: ignore[no-untyped-def]
    """Return whether chains may pass station i at instant k0 and the next one at k1."""
    (at_0, _), (at_1, _) = chain.windows[i], chain.windows[i + 1]
    return chain.left[i, (k0 - at_0) // chain.stride, (k1 - at_1) // chain.stride]


def first_rows(windows: Integers, stride: int) -> Integers:
    """Return the row of the values at the first instant of each window, so that the windows follow one another."""
    sizes = (windows[:, 1] - windows[:, 0]) // stride + 1
    return np.cumsum(sizes) - sizes


@cached(error_model="numpy")
def row_at(chain, i, k):  # type: ignore[no-untyped-def]
    """Return the row of the values at an instant of the window of station i."""
    return chain.rows[i] + (k - chain.windows[i, 0]) // chain.stride


@cached(error_model="numpy")
def next_instants(chain, i, k0):  # type: ignore[no-untyped-def]
    """Return the instants at which chains that pass station i at instant k0 may pass the next one."""
    (low, high), (least, most) = chain.windows[i + 1], chain.durations[i]
    return range(max(low, k0 + least), min(high, k0 + most) + 1, chain.stride)


@cached(error_model="numpy")
def slope(chain, i, k0, k1, dt):  # type: ignore[no-untyped-def]
    """Return sigma of the segment from station i to station i + 1."""
    duration = (k1 - k0) * dt
    left, right = chain.weights[i], chain.weights[i + 1]
    return (right[0] - left[0]) / duration, (right[1] - left[1]) / duration


@cached(error_model="numpy")
def _arrive(chain, tilts, i, k1, s_x, s_z, values, row):  # type: ignore[no-untyped-def]
    """Write the value of passing station i at instant k1 to `row`, with sigma . p, for the better end of the gap."""
    if i == chain.weights.shape[0] - 1:
        # Nothing follows the last station. Only held controls have a tilt at its instant itself.
        for j in range(tilts.low[-1], tilts.high[-1] + 1):
            row[j] = -chain.final[j]
        return
    one = s_x * chain.places[i, 0, 0] + s_z * chain.places[i, 0, 1]
    other = s_x * chain.places[i, 1, 0] + s_z * chain.places[i, 1, 1]
    from_one, from_other = values[row_at(chain, i, k1), 0], values[row_at(chain, i, k1), 1]
    for j in range(tilts.low[k1], tilts.high[k1] + 1):
        a, b = from_one[j] + one, from_other[j] + other
        row[j] = a if a > b else b


@cached(error_model="numpy")
def constants(chain, i, k0, k1, s_x, s_z):  # type: ignore[no-untyped-def]
    """Return the terms of a segment that depend neither on the tilt nor on the place in a gap."""
    w_x, w_z = chain.weights[i + 1, 0] - chain.weights[i, 0], chain.weights[i + 1, 1] - chain.weights[i, 1]
    value = math.sqrt(w_x * w_x + w_z * w_z) * chain.curvature[i, (k1 - k0) // chain.stride]
    if i == chain.weights.shape[0] - 2:
        value += s_x * chain.places[i + 1, 0, 0] + s_z * chain.places[i + 1, 0, 1]
    if i == chain.goal:
        t_z = s_z + chain.tail
        value += chain.position * math.sqrt(s_x * s_x + t_z * t_z)
    return value


@cached(error_model="numpy")
def _sweep(chain, tilts, limits, i, begin, k0, k1, rows, keep):  # type: ignore[no-untyped-def]
    """Add the best rewards of the segment from station i to the values at instant k1; see `tilt_program.sweep`."""
    left, right = chain.weights[i], chain.weights[i + 1]
    if tilts.hold.parts > 0:
        return hold_sweep(k0, k1, left, right, chain.common, tilts, limits, rows, keep)
    return sweep(k0, k1, begin, left, right, chain.common, tilts, chain.final, limits, rows, keep)


@cached(error_model="numpy", nogil=True)
def best_values(begin, chain, tilts, limits, values, choices):  # type: ignore[no-untyped-def]
    """Write the value of the best chain from each station, instant, end of the gap and tilt on.

    `values` and `choices` have the shape (instants of all windows, 2, tilts). `choices` receives the instant at which
    the best chain passes the next station.
    """
    stations, dt = chain.weights.shape[0], limits.dt
    two = np.empty((2, tilts.sin.shape[0]))
    for i in range(stations - 2, -1, -1):
        for k0 in range(chain.windows[i, 0], chain.windows[i, 1] + 1, chain.stride):
            at = row_at(chain, i, k0)
            values[at] = -np.inf
            for k1 in next_instants(chain, i, k0):
                if not is_left(chain, i, k0, k1):
                    continue
                s_x, s_z = slope(chain, i, k0, k1, dt)
                _arrive(chain, tilts, i + 1, k1, s_x, s_z, values, two[0])
                row = two[_sweep(chain, tilts, limits, i, begin, k0, k1, two, TWO_ROWS)]
                constant = constants(chain, i, k0, k1, s_x, s_z)
                for end in range(2 if i > 0 else 1):
                    place, best, choice = chain.places[i, end], values[at, end], choices[at, end]
                    rest = constant - s_x * place[0] - s_z * place[1]
                    for j in range(tilts.low[k0], tilts.high[k0] + 1):
                        if row[j] + rest > best[j]:
                            best[j], choice[j] = row[j] + rest, k1


@cached(error_model="numpy")
def best_chain(begin, chain, tilts, limits, values, choices, start):  # type: ignore[no-untyped-def]
    """Return the passing instants, the ends of the gaps and the tilts of the best chain from a first tilt.

    The tilts are those of the samples, or those at the ends of the stages where controls are held; shape (N+1,).
    """
    stations, count, dt = chain.weights.shape[0], chain.common.shape[0] - 1, limits.dt
    passing, ends, path = np.zeros(stations, np.int64), np.zeros(stations, np.int64), np.zeros(count + 1, np.int64)
    rows = np.empty((count + 1, tilts.sin.shape[0]))
    k0, end, j = np.int64(0), 0, start  # of one type in all iterations, so that callees are compiled once
    for i in range(stations - 1):
        k1 = np.int64(choices[row_at(chain, i, k0), end, j])
        s_x, s_z = slope(chain, i, k0, k1, dt)
        _arrive(chain, tilts, i + 1, k1, s_x, s_z, values, rows[k1 - k0])
        _sweep(chain, tilts, limits, i, begin, k0, k1, rows, ALL_ROWS)
        if tilts.hold.parts > 0:
            left, right = chain.weights[i], chain.weights[i + 1]
            j = hold_follow(k0, k1, left, right, chain.common, tilts, limits, rows, path, j)
        else:
            j = follow(k0, k1, tilts, rows, path, j)
        end = 0
        if i < stations - 2:
            place, value = chain.places[i + 1], values[row_at(chain, i + 1, k1)]
            gain = s_x * (place[1, 0] - place[0, 0]) + s_z * (place[1, 1] - place[0, 1])
            end = 1 if value[1, j] + gain > value[0, j] else 0
        passing[i + 1], ends[i + 1] = k1, end
        k0 = k1
    path[count] = j
    return passing, ends, path


@cached(error_model="numpy", nogil=True)
def best_through(begin, chain, tilts, limits, first, values, backward, past):  # type: ignore[no-untyped-def]
    """Return the value of the best chain through each pair of instants of consecutive stations, shape (m+1, n, n).

    The last two indices count the instants of each window in strides. `first` is the penalty of the first tilt by
    position, and `past` has the values of the problem `backward`, which is reversed in time.
    """
    stations, count, dt = chain.weights.shape[0], chain.common.shape[0] - 1, limits.dt
    best, two = np.full(chain.left.shape, -np.inf), np.empty((2, tilts.sin.shape[0]))
    for i in range(stations - 1):
        for k0 in range(chain.windows[i, 0], chain.windows[i, 1] + 1, chain.stride):
            for k1 in next_instants(chain, i, k0):
                if not is_left(chain, i, k0, k1):
                    continue
                s_x, s_z = slope(chain, i, k0, k1, dt)
                _arrive(chain, tilts, i + 1, k1, s_x, s_z, values, two[0])
                row = two[_sweep(chain, tilts, limits, i, begin, k0, k1, two, TWO_ROWS)]
                constant, found = constants(chain, i, k0, k1, s_x, s_z), -np.inf
                for end in range(2 if i > 0 else 1):
                    place = chain.places[i, end]
                    rest = constant - s_x * place[0] - s_z * place[1]
                    for j in range(tilts.low[k0], tilts.high[k0] + 1):
                        if i == 0:
                            total = row[j] + rest - first[j]
                        else:
                            before = past[row_at(backward, stations - 1 - i, count - k0), end]
                            at = j if tilts.hold.parts > 0 else best_neighbour(before, j, k0 - 1, tilts)
                            total = row[j] + rest + before[at]
                        found = max(found, total)
                at_0, at_1 = (k0 - chain.windows[i, 0]) // chain.stride, (k1 - chain.windows[i + 1, 0]) // chain.stride
                best[i, at_0, at_1] = found
    return best
