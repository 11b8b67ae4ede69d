"""How much thrust can do at most for a weight q(t): a proven bound, by a dynamic programme over the tilt.

Position and velocity do not matter here; the tilt theta is all the state there is. With e = (sin theta, cos theta),

    r(t, theta) = max over f of q . (f e - g e_z) = max(thrust_max q . e, thrust_min q . e) - g q_z.

Theorem. Let q be linear between the instants t_k = k dt, k = 0..N, T = N dt, angles d = rate_max dt = 2 pi / turn
apart, and let first, last >= 0. For every tilt with theta(0) = 0, |theta'| <= rate_max and theta(T) within `slack`
of 2 pi winding, and any thrust within its limits,

    integral of q . a dt  <=  (M_0 + M_1)/2 + first d/2 + last (slack + d/2) + I,
    M_j = max of  sum over k = 0..N-1 of dt r(t_(k+j), theta_k) - first |theta_0| - last |theta_(N-1) - 2 pi winding|
          over sequences of multiples of d, each at most d from the one before,
    I   = d^2/8 sum over k of dt thrust_max |q(t_k)|, averaged over both sums as the M_j are.

Proof, in four steps.
1. Sampling. The integral of r(t, theta(t)) is the average over u in [0, dt] of the sums of dt r(t_k + u, theta(t_k
   + u)). Their terms are tilts at most d apart: each sum is at most what any sequence with that property can reach,
   so no error of the rate accumulates. Nor is the sum made smaller by adding first (rate_max u - |theta_0|) and
   last (slack + rate_max (dt - u) - |theta_(N-1) - 2 pi winding|), which a flight keeps nonnegative.
2. Convexity. For a fixed sequence each sum is convex in u, because q is linear in u and r convex in q; so is their
   maximum S(u). The average of a convex function is at most the mean of its values at both ends, which is the bound,
   with the maximum taken over all real sequences instead of multiples of d.
3. Grid. If V is linear between multiples of d, its maximum over the window [theta - d, theta + d] is, between two
   multiples, the greatest of two linear functions and a constant, convex, hence at most the chord between its
   values at the multiples. And r is at most its own chord plus d^2/8 thrust_max |q|, as it is the greater of two
   functions whose second derivatives are at least -thrust_max |q|. The penalties are linear between multiples. So
   by induction backwards in k the programme on multiples of d, plus I, bounds the programme on all angles.
4. Rounding. All that is added is at most B = sum of dt (thrust_max + g) (|q_x| + |q_z|) + (first + last) times the
   range of angles, in magnitude. A reward is off by at most 32 units in the last place of its magnitude (weight 4,
   angle of the table 14, sine 2, the rest products and sums), a sum of N terms by N units of B. `rounding` is twice
   all that.

Where tilts are held within bounds at some instant (branches of a proof), the sequences are too, one d wider, as
they are sampled up to dt before or after it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array, Quadrotor
from optimal.proof.branches import TiltInterval

UNIT = 2.0**-53
"""Relative rounding of one operation."""
TINY = 1e-300
"""Instead of zero where a length divides."""
FINE, TURN_RANGE = 400, 0.2
"""Least angles of one turn for a gap of 1e-3, and how many more are considered, relatively, so that some grid ends
close to any time."""


LEAST_STEPS = 100
"""Fewest instants of a grid, for vehicles that turn little in the time they have."""


@dataclass(frozen=True)
class TimeGrid:
    """Instants t_k = k dt over which the vehicle can turn by just one of `turn` equal angles.

    Attributes:
        steps: N.
        turn: angles of a whole turn.
        rate_max: of the vehicle [rad/s].
    """

    steps: int
    turn: int
    rate_max: float

    @property
    def angle(self) -> float:
        """Angle between neighbours, d [rad]."""
        return 2 * math.pi / self.turn

    @property
    def dt(self) -> float:
        """Time between instants [s]."""
        return self.angle / self.rate_max

    @property
    def time(self) -> float:
        """T [s], rounded downwards."""
        return self.steps * self.dt * (1 - 8 * UNIT)


def time_grid(time: float, rate_max: float, *, turn: int = FINE) -> TimeGrid:
    """Return the grid whose duration is at least a time, and closest to it.

    Args:
        time: to come close to [s].
        rate_max: of the vehicle [rad/s].
        turn: least angles of one turn.
    """
    grids = []
    turn = max(turn, math.ceil(LEAST_STEPS * 2 * math.pi / (time * rate_max)))
    for angles in range(turn, round(turn * (1 + TURN_RANGE)) + 1):
        steps = max(2, math.ceil(time * rate_max * angles / (2 * math.pi)))
        grids += [TimeGrid(steps, angles, rate_max), TimeGrid(steps + 1, angles, rate_max)]
    return min((grid for grid in grids if grid.time >= time), key=lambda grid: grid.time)


def angles_for(gap: float) -> int:
    """Return the angles of a turn whose interpolation, falling with their square, costs a small share of a gap."""
    return max(100, math.ceil(FINE * math.sqrt(1e-3 / gap)))


class TiltBound(NamedTuple):
    """What `TiltProgram` found; integral of q . a dt <= value + interpolation + rounding.

    Attributes:
        value: (M_0 + M_1)/2 + first d/2 + last (slack + d/2).
        interpolation: I.
        rounding: what floating point arithmetic may have lost.
        slope: a subgradient of value + interpolation by q, shape (N+1, 2): dt a of the maximising sequences, averaged
            over both, and the interpolation's.
        ends: its derivatives by first and last [rad], shape (2,).
    """

    value: float
    interpolation: float
    rounding: float
    slope: Array
    ends: Array


class TiltProgram:
    """The programme of one vehicle, grid and winding, ready for any weight.

    Args:
        quadrotor: its limits and gravity count.
        grid: instants and angles.
        winding: whole turns between start and end.
        slack: how far from them the last tilt may be [rad].
        held: tilts held within bounds.
    """

    def __init__(
        self, quadrotor: Quadrotor, grid: TimeGrid, winding: int, slack: float = 0.0, held: Sequence[TiltInterval] = ()
    ) -> None:
        self.quadrotor, self.grid, self.winding, self.slack = quadrotor, grid, winding, slack
        self.low, self.high = _reach(grid, winding, slack, held)
        self.possible = bool((self.low <= self.high).all())
        self.origin = int(self.low.min()) - 1
        angle = grid.angle * np.arange(self.origin, int(self.high.max()) + 2)
        self._sin, self._cos = np.sin(angle), np.cos(angle)
        self._values = _scratch(grid.steps, len(angle))

    def __call__(self, weight: Array, first: float, last: float) -> TiltBound:
        """Bound the integral for one weight.

        Args:
            weight: q at the instants, shape (N+1, 2).
            first, last: penalties of the first and last tilt, not negative.
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
            rounding=float(2 * (count + 64) * UNIT * size),
            slope=slope + (share / np.maximum(length, TINY))[:, None] * weight,
            ends=ends,
        )


@lru_cache(maxsize=1)
def ready() -> None:
    """Have the kernel compiled, or loaded from disk, before any clock runs; it takes seconds on a new machine."""
    TiltProgram(Quadrotor(), TimeGrid(LEAST_STEPS, LEAST_STEPS, 10.0), 0)(np.zeros((LEAST_STEPS + 1, 2)), 0.0, 0.0)


def _reach(
    grid: TimeGrid, winding: int, slack: float, held: Sequence[TiltInterval]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the least and greatest multiples of d that sample k may take, shape (N,) each; crossed where none."""
    k, count, target = np.arange(grid.steps), grid.steps, winding * grid.turn
    far = math.ceil(slack / grid.angle)
    low = np.maximum(-(k + 1), target - far - (count - k))
    high = np.minimum(k + 1, target + far + (count - k))
    for share, least, most in held:
        at = min(max(round(share * count), 0), count)
        apart = np.maximum(np.abs(k - at), np.abs(k + 1 - at))
        low = np.maximum(low, np.floor(least / grid.angle) - apart)
        high = np.minimum(high, np.ceil(most / grid.angle) + apart)
    return low.astype(np.int64), high.astype(np.int64)


@lru_cache(maxsize=8)
def _scratch(count: int, width: int) -> Array:
    return np.empty((count, width))


@numba.njit(cache=True, error_model="numpy")
def _sweep(  # type: ignore[no-untyped-def]
    weight, sin, cos, low, high, origin, limits, dt, first, last, target, values, slope
):
    """Return M and the ends of its sequence; first and last are per multiple of d.

    Half of dt a of the sequence is added to `slope`.
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
            # What cannot be reached is worth nothing.
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
    thrust_min, thrust_max, gravity = limits
    weight = gravity * q_z
    for i in range(row.shape[0]):
        lift = q_x * sin[i] + q_z * cos[i]
        strong, weak = thrust_max * lift, thrust_min * lift
        row[i] = (strong if strong > weak else weak) - weight


@numba.njit(cache=True, error_model="numpy")
def _add_best(row, left, middle, right):  # type: ignore[no-untyped-def]
    for i in range(row.shape[0]):
        best = left[i] if left[i] > right[i] else right[i]
        row[i] += best if best > middle[i] else middle[i]
