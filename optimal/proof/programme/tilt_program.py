"""A proven bound of the integral of q . a, for a given weight q(t), by a dynamic programme over the tilt.

The only state is the tilt theta. With e = (sin theta, cos theta), the greatest reward over the thrust f is

    r(t, theta) = max over f of q . (f e - g e_z) = max(thrust_max q . e, thrust_min q . e) - g q_z.

Theorem. Let t_k = k dt for k = 0..N, T = N dt, and let q be linear between these instants. Let d = rate_max dt =
2 pi / turn be the angle between grid angles, and let first, last >= 0 be penalties. Consider any tilt with
theta(0) = 0, |theta'| <= rate_max and theta(T) within `slack` of 2 pi winding, and any thrust within its limits. Then

    integral of q . a dt  <=  (M_0 + M_1)/2 + first d/2 + last (slack + d/2),

    M_j = max of  sum over k = 0..N-1 of dt (r(t_(k+j), theta_k) + d^2/8 thrust_max |q(t_(k+j))|)
                  - first |theta_0| - last |theta_(N-1) - 2 pi winding|
          over all sequences theta_0, ..., theta_(N-1) of multiples of d with |theta_k - theta_(k-1)| <= d.

Proof.

Step 1 (sampling). The integral of r(t, theta(t)) over [0, T] is the average over u in [0, dt] of the sums
sum over k of dt r(t_k + u, theta_k) with theta_k = theta(t_k + u). By the rate limit, consecutive theta_k of one sum
differ by at most d. Each sum is therefore at most the maximum over all real sequences with that property, and no error
of the rate accumulates. A flight keeps the two terms first (rate_max u - |theta_0|) and
last (slack + rate_max (dt - u) - |theta_(N-1) - 2 pi winding|) nonnegative, so adding them does not decrease the sum.
The averages over u of first rate_max u and of last (slack + rate_max (dt - u)) are first d/2 and last (slack + d/2).

Step 2 (convexity). For a fixed sequence each sum is convex in u, because q is linear in u and r is convex in q. The
maximum S(u) over sequences is convex too. The average of a convex function is at most the mean of its two end values.
This is the stated bound without d^2/8 thrust_max |q|, with the maxima taken over all real sequences.

Step 3 (grid). Let V be linear between multiples of d. For theta between two neighbouring multiples, the maximum of V
over the window [theta - d, theta + d] is the greatest of two linear functions and a constant. It is convex, hence at
most the chord between its values at the two multiples. The reward r is at most its own chord plus
d^2/8 thrust_max |q|, because it is the greater of two functions whose second derivatives are at least
-thrust_max |q|. The penalties are concave or linear between multiples. By induction backwards in k, the programme on
multiples of d bounds the programme on all angles.

Circle. For the tilt modulo a whole turn, with distances on the circle, all steps hold unchanged. One programme then
bounds the flights of all windings.

Held tilts. A branch of a proof may hold the tilt within bounds at some instant, not necessarily one of the grid. The
sequences are then held within bounds that are wider by d for each dt between the sample and the instant.

Rounding is bounded by `proof.chain_terms`. A reward is off by at most 32 units in the last place of its magnitude: 8
from the weight, 10 from the angle of the table, 2 from the sine, the rest from products and sums.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatgym.kernels.compilation import cached
from flatgym.quadrotor import Array, Quadrotor
from optimal.proof.branches import TiltInterval
from optimal.proof.programme.rounding import LEAST_LENGTH, TIME_MARGIN
from optimal.proof.programme.time_grid import HoldGrid, TimeGrid
from optimal.proof.programme.zero_order_hold import Hold, hold_tables, no_hold

Grid = TimeGrid | HoldGrid
Integers = NDArray[np.int64]


class Tilts(NamedTuple):
    """The tilts of all samples, as positions in tables that have one spare entry at each end.

    Attributes:
        low, high: first and last position of sample k, shape (N,).
        circular: whether the tables are one whole turn, closed to a circle.
        sin, cos: sine and cosine by position.
        first, last: distance to 0 and to the winding by position, as multiples of d.
        zero: position of the angle 0.
        hold: tables for controls that are held (`zero_order_hold`). `low` and `high` then belong to the
            instants, shape (N+1,), and the spare entries are those that a step reaches.
    """

    low: Integers
    high: Integers
    circular: bool
    sin: Array
    cos: Array
    first: Array
    last: Array
    zero: int
    hold: Hold

    @property
    def possible(self) -> bool:
        """Whether every sample has a tilt: whole turns take time."""
        return bool((self.low <= self.high).all())


class Limits(NamedTuple):
    """Limits of the vehicle and step of the grid, for the kernels.

    Attributes:
        thrust_min, thrust_max, gravity: of the vehicle [m/s^2].
        dt: time step [s].
        bulge: d^2/8 thrust_max, the interpolation error for a weight of length 1 [m/s^2].
    """

    thrust_min: float
    thrust_max: float
    gravity: float
    dt: float
    bulge: float


def limits(quadrotor: Quadrotor, grid: Grid) -> Limits:
    """Return the limits of a vehicle on a grid."""
    bulge = grid.angle**2 / 8 * quadrotor.thrust_max
    return Limits(quadrotor.thrust_min, quadrotor.thrust_max, quadrotor.gravity, grid.dt, bulge)


def tilts(
    grid: Grid,
    winding: int | None,
    slack: float = 0.0,
    held: Sequence[TiltInterval] = (),
    duration: float | None = None,
) -> Tilts:
    """Return the tilts of a class of flights.

    Args:
        grid: instants and angles.
        winding: whole turns of the tilt between start and end; None for all windings, on the circle.
        slack: greatest deviation of the last tilt from the winding [rad].
        held: bounds of the tilt at some instants; none on the circle.
        duration: duration of the flights to whose shares `held` refers [s]. They hover first, until they fill the grid.
    """
    turn, hold = grid.turn, isinstance(grid, HoldGrid)
    pad = grid.reach if isinstance(grid, HoldGrid) else 1
    if winding is None:
        if held or hold:
            raise ValueError("tilts can be held within bounds, and controls over steps, for one winding only")
        low, high = np.zeros(grid.steps), np.full(grid.steps, turn - 1.0)
        index, target = np.arange(turn), 0
        first = last = np.minimum(index, turn - index)
    else:
        target = winding * turn
        low, high = _reach(grid, target, slack, held, grid.time if duration is None else duration)
        index = np.arange(int(low.min()), int(high.max()) + 1)
        first, last = np.abs(index), np.abs(index - target)
    angle = grid.angle * ((index + turn // 2) % turn - turn // 2)
    tables = (np.sin(angle), np.cos(angle), first, last)
    sin, cos, first, last = (np.pad(table.astype(np.float64), pad) for table in tables)
    origin = int(index[0]) - pad if len(index) else 0
    stages = hold_tables(grid, index, pad) if isinstance(grid, HoldGrid) else no_hold()
    lowest, highest = (low - origin).astype(np.int64), (high - origin).astype(np.int64)
    return Tilts(lowest, highest, winding is None, sin, cos, first, last, -origin, stages)


def _reach(grid: Grid, target: int, slack: float, held: Sequence[TiltInterval], duration: float) -> tuple[Array, Array]:
    """Return the least and greatest multiple of d of each sample, or of each instant if controls are held.

    There is none where least > greatest.
    """
    count, margin = grid.steps, math.ceil(slack / grid.angle)
    if isinstance(grid, HoldGrid):
        early = late = np.arange(count + 1)
        before, pace = -(-late * grid.reach // grid.parts), grid.reach / grid.parts
    else:  # sample k lies between the instants k and k + 1, and the vehicle turns by one angle in a time step
        early = np.arange(count)
        before, pace = (late := early + 1), 1.0
    after = before[::-1]
    low, high = np.maximum(-before, target - margin - after), np.minimum(before, target + margin + after)
    low, high = low.astype(np.float64), high.astype(np.float64)
    for share, least, greatest in held:
        at = count - (1 - share) * duration / grid.dt
        apart = pace * np.maximum(np.abs(early - at), np.abs(late - at)) + TIME_MARGIN * count
        low = np.maximum(low, np.floor(least / grid.angle - apart))
        high = np.minimum(high, np.ceil(greatest / grid.angle + apart))
    return low, high


@cached(error_model="numpy")
def sweep(k0, k1, begin, left, right, common, tilts, final, limits, rows, keep):  # type: ignore[no-untyped-def]
    """Add the best rewards of samples k0..k1-1 to the values at sample k1, for all tilts.

    The weight at t_k is linear in k from `left` at k0 to `right` at k1, plus common[k]. Sample k has the weight at
    t_(k+begin). `final` is subtracted at the last sample of the grid.

    `rows` has the values at sample k1 in its row k1 - k0 with `keep`, else in row 0. With `keep` row k - k0 receives
    the values of sample k; else two rows are used in turn. Returns the row with the values of sample k0.
    """
    low, high, last, width = tilts.low, tilts.high, tilts.low.shape[0] - 1, tilts.sin.shape[0]
    length, dt = k1 - k0, limits.dt
    at = length if keep else 0
    for k in range(k1 - 1, k0 - 1, -1):
        share = (k + begin - k0) / length
        q_x = dt * (left[0] + (right[0] - left[0]) * share + common[k + begin, 0])
        q_z = dt * (left[1] + (right[1] - left[1]) * share + common[k + begin, 1])
        after = rows[at]
        at = at - 1 if keep else 1 - at
        row, b, e = rows[at], low[k], high[k] + 1
        _rewards(row[b:e], tilts.sin[b:e], tilts.cos[b:e], q_x, q_z, limits)
        if k == last:
            for i in range(b, e):
                row[i] -= final[i]
            continue
        if tilts.circular:
            after[0], after[width - 1] = after[width - 2], after[1]
        else:  # Unreachable angles have value -inf.
            for i in range(b - 1, min(low[k + 1], e + 1)):
                after[i] = -np.inf
            for i in range(max(high[k + 1] + 1, b - 1), e + 1):
                after[i] = -np.inf
        _add_best(row[b:e], after[b - 1 : e - 1], after[b:e], after[b + 1 : e + 1])
    return at


@cached(error_model="numpy")
def _rewards(row, sin, cos, q_x, q_z, limits):  # type: ignore[no-untyped-def]
    """Write the rewards of one sample, with the interpolation error, for a weight times dt."""
    thrust_min, thrust_max = limits.thrust_min, limits.thrust_max
    rest = limits.bulge * math.sqrt(q_x * q_x + q_z * q_z) - limits.gravity * q_z
    for i in range(row.shape[0]):
        lift = q_x * sin[i] + q_z * cos[i]
        strong, weak = thrust_max * lift, thrust_min * lift
        row[i] = (strong if strong > weak else weak) + rest


@cached(error_model="numpy")
def _add_best(row, left, middle, right):  # type: ignore[no-untyped-def]
    """Add the greatest of three neighbouring values of the next instant."""
    for i in range(row.shape[0]):
        best = left[i] if left[i] > right[i] else right[i]
        row[i] += best if best > middle[i] else middle[i]


@cached(error_model="numpy")
def best_neighbour(row, j, k, tilts):  # type: ignore[no-untyped-def]
    """Return the position of the greatest of up to three values of sample k that can be reached from position j."""
    width, nearest, greatest = tilts.sin.shape[0], j, -np.inf
    for i in (j, j - 1, j + 1):
        if tilts.circular:
            i = width - 2 if i == 0 else (1 if i == width - 1 else i)
        elif i < tilts.low[k] or i > tilts.high[k]:
            continue
        if row[i] > greatest:
            nearest, greatest = i, row[i]
    return nearest


@cached(error_model="numpy")
def follow(k0, k1, tilts, rows, path, j):  # type: ignore[no-untyped-def]
    """Write the best tilts of samples k0..k1-1 to `path`, from position j on; return the position of the next one."""
    for k in range(k0, k1):
        path[k] = j
        if k < tilts.low.shape[0] - 1:
            j = best_neighbour(rows[k + 1 - k0], j, k + 1, tilts)
    return j


def gradient(begin: int, path: Integers, weight: Array, tilts: Tilts, limits: Limits) -> Array:
    """Return the derivative of the sum over all samples with respect to the weights at the instants, shape (N+1, 2).

    Args:
        begin: whether the weight of a sample is that at its begin (0) or at its end (1).
        path: positions of the tilts of the samples, shape (N+1,); the last is not used.
        weight: at the instants, shape (N+1, 2).
        tilts, limits: of the programme.
    """
    weight, path = weight[begin : len(weight) - 1 + begin], path[:-1]
    up = np.stack([tilts.sin[path], tilts.cos[path]], axis=-1)
    thrust = np.where((weight * up).sum(axis=1) > 0, limits.thrust_max, limits.thrust_min)[:, None]
    unit = weight / np.maximum(np.hypot(*weight.T), LEAST_LENGTH)[:, None]
    found = np.zeros((len(weight) + 1, 2))
    found[begin : len(weight) + begin] = limits.dt * (thrust * up - [0.0, limits.gravity] + limits.bulge * unit)
    return found
