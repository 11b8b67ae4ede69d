"""A proven bound of the integral of q . a, for a given weight q(t), by a dynamic programme over the tilt.

The only state is the tilt theta. With e = (sin theta, cos theta), the greatest reward over the thrust f is

    r(t, theta) = max over f of q . (f e - g e_z) = max(thrust_max q . e, thrust_min q . e) - g q_z.

Theorem. Let t_k = k dt for k = 0..N, T = N dt, and let q be linear between these instants. Let d = rate_max dt =
2 pi / turn be the angle between grid angles, and let first, last >= 0 be penalties. Consider any tilt with
theta(0) = 0, |theta'| <= rate_max and theta(T) within `slack` of 2 pi winding, and any thrust within its limits. Then

    integral of q . a dt  <=  (M_0 + M_1)/2 + first d/2 + last (slack + d/2) + I,

    M_j = max of  sum over k = 0..N-1 of dt r(t_(k+j), theta_k) - first |theta_0| - last |theta_(N-1) - 2 pi winding|
          over all sequences theta_0, ..., theta_(N-1) of multiples of d with |theta_k - theta_(k-1)| <= d,
    I   = d^2/8 sum over k of dt thrust_max |q(t_k)|, averaged over both sums as the M_j are.

Proof.

Step 1 (sampling). The integral of r(t, theta(t)) over [0, T] is the average over u in [0, dt] of the sums
sum over k of dt r(t_k + u, theta_k) with theta_k = theta(t_k + u). By the rate limit, consecutive theta_k of one sum
differ by at most d. Each sum is therefore at most the maximum over all real sequences with that property, and no error
of the rate accumulates. A flight keeps the two terms first (rate_max u - |theta_0|) and
last (slack + rate_max (dt - u) - |theta_(N-1) - 2 pi winding|) nonnegative, so adding them does not decrease the sum.
The averages over u of first rate_max u and of last (slack + rate_max (dt - u)) are first d/2 and last (slack + d/2).

Step 2 (convexity). For a fixed sequence each sum is convex in u, because q is linear in u and r is convex in q. The
maximum S(u) over sequences is convex too. The average of a convex function is at most the mean of its two end values.
This is the stated bound, with the maxima taken over all real sequences instead of multiples of d.

Step 3 (grid). Let V be linear between multiples of d. For theta between two neighbouring multiples, the maximum of V
over the window [theta - d, theta + d] is the greatest of two linear functions and a constant. It is convex, hence at
most the chord between its values at the two multiples. The reward r is at most its own chord plus
d^2/8 thrust_max |q|, because it is the greater of two functions whose second derivatives are at least
-thrust_max |q|. The penalties are linear between multiples. By induction backwards in k, the programme on multiples
of d plus I bounds the programme on all angles.

Step 4 (rounding). The magnitudes of all added terms sum to at most B = sum of dt (thrust_max + g) (|q_x| + |q_z|) +
(first + last) times the range of angles. A reward is off by at most 32 units in the last place of its magnitude: 4 from
the weight, 14 from the angle of the table, 2 from the sine, the rest from products and sums. A sum of N terms is off by
at most N units of B. `rounding` is twice the total.

Held tilts. A branch of a proof may hold the tilt within bounds at some instants. The sequences are then held within
bounds that are wider by one d, because they are sampled up to dt before or after the instant.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array, Quadrotor
from optimal.proof.branches import TiltInterval
from optimal.proof.rounding import LEAST_LENGTH, UNIT_ROUNDOFF
from optimal.proof.time_grid import LEAST_STEPS, TimeGrid


class TiltBound(NamedTuple):
    """The bound of `TiltProgram`: integral of q . a dt <= value + interpolation + rounding.

    Attributes:
        value: (M_0 + M_1)/2 + first d/2 + last (slack + d/2).
        interpolation: I.
        rounding: bound of the rounding error.
        slope: a subgradient of value + interpolation with respect to q, shape (N+1, 2): dt a of the maximising
            sequences, averaged over both, plus the subgradient of the interpolation.
        ends: the derivatives with respect to first and last [rad], shape (2,).
    """

    value: float
    interpolation: float
    rounding: float
    slope: Array
    ends: Array


class TiltProgram:
    """The dynamic programme of one vehicle, grid and winding, for any weight.

    Args:
        quadrotor: the vehicle, for its limits and gravity.
        grid: instants and angles.
        winding: whole turns of the tilt between start and end.
        slack: greatest deviation of the last tilt from the winding [rad].
        held: bounds of the tilt at some instants.
    """

    def __init__(
        self, quadrotor: Quadrotor, grid: TimeGrid, winding: int, slack: float = 0.0, held: Sequence[TiltInterval] = ()
    ) -> None:
        self.quadrotor, self.grid, self.winding, self.slack = quadrotor, grid, winding, slack
        self.low, self.high = _index_bounds(grid, winding, slack, held)
        self.possible = bool((self.low <= self.high).all())
        self.origin = int(self.low.min()) - 1
        angle = grid.angle * np.arange(self.origin, int(self.high.max()) + 2)
        self._sin, self._cos = np.sin(angle), np.cos(angle)
        self._values = _workspace(grid.steps, len(angle))

    def __call__(self, weight: Array, first: float, last: float) -> TiltBound:
        """Bound the integral for one weight.

        Args:
            weight: q at the instants, shape (N+1, 2).
            first, last: nonnegative penalties of the first and last tilt.
        """
        grid, quadrotor = self.grid, self.quadrotor
        count, d, dt = grid.steps, grid.angle, grid.dt
        limits = (quadrotor.thrust_min, quadrotor.thrust_max, quadrotor.gravity)
        value, slope, ends = 0.0, np.zeros((count + 1, 2)), np.array([d / 2, self.slack + d / 2])
        target = self.winding * grid.turn
        for begin in (0, 1):
            best, start, end = _sweep(
                weight[begin : begin + count], self._sin, self._cos, self.low, self.high, self.origin, limits, dt,
                first * d, last * d, target, self._values, slope[begin : begin + count],
            )  # fmt: skip
            value += best / 2
            ends -= d / 2 * np.array([abs(start), abs(end - target)])
        length = np.hypot(weight[:, 0], weight[:, 1])
        share = np.full(count + 1, dt * d**2 / 8 * quadrotor.thrust_max)
        share[[0, -1]] /= 2
        size = 2 * dt * (quadrotor.thrust_max + quadrotor.gravity) * np.abs(weight).sum()
        size += (first + last) * (d * len(self._sin) + self.slack)
        return TiltBound(
            value=value + first * d / 2 + last * (self.slack + d / 2),
            interpolation=float(share @ length),
            rounding=float(2 * (count + 64) * UNIT_ROUNDOFF * size),
            slope=slope + (share / np.maximum(length, LEAST_LENGTH))[:, None] * weight,
            ends=ends,
        )


@lru_cache(maxsize=1)
def compile_kernels() -> None:
    """Compile the kernels or load them from disk, before a time budget starts. The first compilation takes seconds."""
    TiltProgram(Quadrotor(), TimeGrid(LEAST_STEPS, LEAST_STEPS, 10.0), 0)(np.zeros((LEAST_STEPS + 1, 2)), 0.0, 0.0)


def _index_bounds(
    grid: TimeGrid, winding: int, slack: float, held: Sequence[TiltInterval]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the least and greatest multiple of d of sample k, shape (N,) each; least > greatest if there is none."""
    k, count, target = np.arange(grid.steps), grid.steps, winding * grid.turn
    margin = math.ceil(slack / grid.angle)
    low = np.maximum(-(k + 1), target - margin - (count - k))
    high = np.minimum(k + 1, target + margin + (count - k))
    for share, least, greatest in held:
        at = min(max(round(share * count), 0), count)
        apart = np.maximum(np.abs(k - at), np.abs(k + 1 - at))
        low = np.maximum(low, np.floor(least / grid.angle) - apart)
        high = np.minimum(high, np.ceil(greatest / grid.angle) + apart)
    return low.astype(np.int64), high.astype(np.int64)


@lru_cache(maxsize=8)
def _workspace(count: int, width: int) -> Array:
    """Return an array for the values of all instants, shared by programmes of equal size."""
    return np.empty((count, width))


@numba.njit(cache=True, error_model="numpy")
def _sweep(  # type: ignore[no-untyped-def]
    weight, sin, cos, low, high, origin, limits, dt, first, last, target, values, slope
):
    """Return M and both ends of its maximising sequence, as multiples of d.

    The penalties first and last are per multiple of d. Half of dt a of the sequence is added to `slope`.
    """
    thrust_min, thrust_max, gravity = limits
    count = weight.shape[0]
    for k in range(count - 1, -1, -1):
        begin, end = low[k] - origin, high[k] - origin + 1
        row = values[k, begin:end]
        _rewards(row, sin[begin:end], cos[begin:end], dt * weight[k, 0], dt * weight[k, 1], limits)
        if k == count - 1:
            for i in range(begin, end):
                values[k, i] -= last * abs(i + origin - target)
        else:
            # Unreachable angles have value -inf.
            after, inner, outer = values[k + 1], low[k + 1] - origin, high[k + 1] - origin + 1
            for i in range(begin - 1, inner):
                after[i] = -np.inf
            for i in range(outer, end + 1):
                after[i] = -np.inf
            _add_best(row, after[begin - 1 : end - 1], after[begin:end], after[begin + 1 : end + 1])
    best, at = -np.inf, low[0]
    for i in range(low[0], high[0] + 1):
        value = values[0, i - origin] - first * abs(i)
        if value > best:
            best, at = value, i
    start = at
    for k in range(count):
        nearest, greatest = at, -np.inf
        for i in range(max(at - 1, low[k]), min(at + 1, high[k]) + 1) if k > 0 else range(at, at + 1):
            if values[k, i - origin] > greatest:
                nearest, greatest = i, values[k, i - origin]
        at = nearest
        up, ahead = cos[at - origin], sin[at - origin]
        thrust = thrust_max if weight[k, 0] * ahead + weight[k, 1] * up > 0 else thrust_min
        slope[k, 0] += dt / 2 * thrust * ahead
        slope[k, 1] += dt / 2 * (thrust * up - gravity)
    return best, start, at


@numba.njit(cache=True, error_model="numpy")
def _rewards(row, sin, cos, q_x, q_z, limits):  # type: ignore[no-untyped-def]
    """Write the rewards r of one instant."""
    thrust_min, thrust_max, gravity = limits
    weight = gravity * q_z
    for i in range(row.shape[0]):
        lift = q_x * sin[i] + q_z * cos[i]
        strong, weak = thrust_max * lift, thrust_min * lift
        row[i] = (strong if strong > weak else weak) - weight


@numba.njit(cache=True, error_model="numpy")
def _add_best(row, left, middle, right):  # type: ignore[no-untyped-def]
    """Add the greatest of three neighbouring values of the next instant."""
    for i in range(row.shape[0]):
        best = left[i] if left[i] > right[i] else right[i]
        row[i] += best if best > middle[i] else middle[i]
