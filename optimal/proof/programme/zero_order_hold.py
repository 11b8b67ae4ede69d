"""The tilt programme for controls that are held over a step: a tighter bound for flights in an environment.

An environment holds the control over steps of dt. Thrust f and rate omega are then constant on each step, and the tilt
is linear there. A stage is a step, or a part of a step between the instants t_a and t_b at which a hoop may be passed.

Theorem. Let q be linear on each stage. Let d = 2 pi / turn be the angle between grid angles, and let the reach of a
stage of duration h be a whole number of at least rate_max h / d. For any flight with held controls from theta(0) = 0,
the integral of q . a is at most the maximum, over sequences of multiples of d at the ends of the stages whose
differences are within the reach, of the sum of

    R(theta, theta') + d^2/8 thrust_max (|q_a| + |q_b|) h/2,
    R(theta, theta') = max(thrust_max I, thrust_min I) - g h (q_a + q_b)_z/2,

where I is the integral of q . (sin, cos) of the linear tilt from theta to theta'.

Proof. A control held over a step is constant on its parts, so R bounds the integral over a stage for its own tilts at
both ends. There is no sampling error. For the grid, cut each square of the plane (theta, theta') into two triangles by
its diagonal theta' - theta = const. The set of differences within the reach is a union of such triangles. At a share of
the stage the tilt is a linear function of (theta, theta'), and its values at the vertices of a triangle lie within d of
each other. Every q . (sin, cos) of it is at most the linear interpolation of its values at the vertices plus
d^2/8 |q|. Integrated, this bounds I and -I, hence also R, which is the greater of two multiples of I with factors
between 0 and thrust_max. The values of the next stage are at most their own interpolation, by induction backwards in
time. The interpolation on a triangle interpolates linearly in theta and in theta' alone, so the programme on multiples
of d bounds the programme on all angles.

The integral has a closed form. With the mean m of theta and theta', a half of their difference, the mean weight q and
its slope s, and the spherical Bessel functions j0 and j1,

    I = sin m (h j0(a) q_x - h^2/2 j1(a) s_z) + cos m (h j0(a) q_z + h^2/2 j1(a) s_x).

Passing times. Within the step in which a hoop is passed, the bound permits other controls after the passing than
before. This is a relaxation. Chains (`chain`) pass hoops at the instants of the grid, which divide each
step into equal parts, and their theorem holds unchanged.

Shorter flights. A flight in fewer steps could hover first, for a whole number of steps.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatgym.kernels.compilation import cached
from flatgym.quadrotor import Array, spherical_bessel
from optimal.proof.programme.rounding import LEAST_LENGTH
from optimal.proof.programme.time_grid import HoldGrid

Integers = NDArray[np.int64]


class Hold(NamedTuple):
    """Tables of the stages; empty for controls that may change at any time.

    Attributes:
        parts: instants of the grid in one step; 0 if controls may change at any time.
        reach: greatest change of position in the tables by length of the stage in instants, shape (parts+1,).
        sin, cos: sine and cosine in the middle between a position and the next one, by position.
        even, odd: j0 and j1 by the absolute change of position, shape (reach of a step + 1,).
    """

    parts: int
    reach: Integers
    sin: Array
    cos: Array
    even: Array
    odd: Array


def hold_tables(grid: HoldGrid, index: Integers, pad: int) -> Hold:
    """Return the tables of a grid, for positions of the angles `index` padded by `pad` entries at both ends."""
    turn, size = grid.turn, np.arange(grid.parts + 1)
    reach = np.ceil(size * grid.reach / grid.parts).astype(np.int64)
    middle = np.concatenate([index[0] - pad + np.arange(pad), index, index[-1] + 1 + np.arange(pad)])
    angle = grid.angle * ((middle + turn // 2) % turn - turn // 2 + 0.5)
    even, odd = spherical_bessel(grid.angle / 2 * np.arange(grid.reach + 1.0))
    return Hold(grid.parts, reach, np.sin(angle), np.cos(angle), even, odd)


def no_hold() -> Hold:
    """Return the tables for controls that may change at any time."""
    return Hold(0, np.zeros(0, np.int64), *np.zeros((4, 0)))


@cached(error_model="numpy")
def stage_start(k, k0, parts):  # type: ignore[no-untyped-def]
    """Return the first instant of the stage that ends at instant k of a segment that begins at instant k0."""
    return max(k0, (k - 1) // parts * parts)


@cached(error_model="numpy")
def _weight(k, k0, k1, left, right, common):  # type: ignore[no-untyped-def]
    """Return the weight at an instant of a segment."""
    share = (k - k0) / (k1 - k0)
    return (
        left[0] + (right[0] - left[0]) * share + common[k, 0],
        left[1] + (right[1] - left[1]) * share + common[k, 1],
    )


@cached(error_model="numpy")
def _force(change, q_a, q_b, h, hold):  # type: ignore[no-untyped-def]
    """Return the factors of sin m and cos m in the integral I, for a change of position."""
    even, odd = hold.even[abs(change)] * h / 2, hold.odd[abs(change)] * h / 2
    if change < 0:
        odd = -odd
    return (
        even * (q_a[0] + q_b[0]) - odd * (q_b[1] - q_a[1]),
        even * (q_a[1] + q_b[1]) + odd * (q_b[0] - q_a[0]),
    )


@cached(error_model="numpy")
def hold_sweep(k0, k1, left, right, common, tilts, limits, rows, keep):  # type: ignore[no-untyped-def]
    """Add the best rewards of the stages from instant k0 to k1 to the values at k1, for all tilts.

    Arguments and result are those of `tilt_program.sweep`. With `keep`, only the rows at the ends of
    stages are written.
    """
    hold, low, high, b = tilts.hold, tilts.low, tilts.high, k1
    at = k1 - k0 if keep else 0
    q_b = _weight(b, k0, k1, left, right, common)
    while b > k0:
        a = stage_start(b, k0, hold.parts)
        after = rows[at]
        at = a - k0 if keep else 1 - at
        row, reach, first, end = rows[at], hold.reach[b - a], low[a], high[a] + 1
        for i in range(first - reach, min(low[b], end + reach)):
            after[i] = -np.inf
        for i in range(max(high[b] + 1, first - reach), end + reach):
            after[i] = -np.inf
        q_a, h = _weight(a, k0, k1, left, right, common), (b - a) * limits.dt
        row[first:end] = -np.inf
        for change in range(-reach, reach + 1):
            force = _force(change, q_a, q_b, h, hold)
            i = first + change // 2  # the position of the middle, or the one before it
            sin, cos = (hold.sin, hold.cos) if change % 2 else (tilts.sin, tilts.cos)
            _raise(row[first:end], sin[i:], cos[i:], after[first + change :], force, limits)
        row[first:end] += _rest(q_a, q_b, h, limits)
        b, q_b = a, q_a
    return at


@cached(error_model="numpy")
def _raise(row, sin, cos, after, force, limits):  # type: ignore[no-untyped-def]
    """Raise the values of a row to those of one change of position."""
    up_x, up_z = limits.thrust_max * force[0], limits.thrust_max * force[1]
    weak = limits.thrust_min / limits.thrust_max
    for i in range(row.shape[0]):
        strong = up_x * sin[i] + up_z * cos[i]
        value = after[i] + (strong if strong > 0 else weak * strong)
        row[i] = value if value > row[i] else row[i]


@cached(error_model="numpy")
def _rest(q_a, q_b, h, limits):  # type: ignore[no-untyped-def]
    """Return the terms of a stage that do not depend on the tilt."""
    length = math.sqrt(q_a[0] ** 2 + q_a[1] ** 2) + math.sqrt(q_b[0] ** 2 + q_b[1] ** 2)
    return h / 2 * (limits.bulge * length - limits.gravity * (q_a[1] + q_b[1]))


@cached(error_model="numpy")
def hold_follow(k0, k1, left, right, common, tilts, limits, rows, path, j):  # type: ignore[no-untyped-def]
    """Write the best positions at the ends of the stages to `path`, from position j on; return the last one."""
    hold, a = tilts.hold, k0
    while a < k1:
        path[a] = j
        b = min(k1, (a // hold.parts + 1) * hold.parts)
        q_a, q_b = _weight(a, k0, k1, left, right, common), _weight(b, k0, k1, left, right, common)
        best, found, reach = -np.inf, j, hold.reach[b - a]
        for change in range(-reach, reach + 1):
            if not tilts.low[b] <= j + change <= tilts.high[b]:
                continue
            force, i = _force(change, q_a, q_b, (b - a) * limits.dt, hold), j + change // 2
            sin, cos = (hold.sin[i], hold.cos[i]) if change % 2 else (tilts.sin[i], tilts.cos[i])
            lift = force[0] * sin + force[1] * cos
            thrust = limits.thrust_max if lift > 0 else limits.thrust_min
            value = thrust * lift + rows[b - k0, j + change]
            if value > best:
                best, found = value, j + change
        a, j = b, found
    return j


def hold_gradient(passing: Integers, path: Integers, weight: Array, tilts: Any, limits: Any) -> Array:
    """Return the derivative of the sum over all stages with respect to the weights at the instants, shape (N+1, 2).

    Args:
        passing: instants at which the stations are passed, shape (m+2,).
        path: positions of the tilts at the ends of the stages, shape (N+1,).
        weight: at the instants, shape (N+1, 2).
        tilts, limits: of the programme.
    """
    hold, count = tilts.hold, len(weight) - 1
    ends = np.union1d(np.arange(0, count + 1, hold.parts), passing)
    a, b = ends[:-1], ends[1:]
    change, h = path[b] - path[a], ((b - a) * limits.dt)[:, None]
    middle, odd_change = path[a] + change // 2, change % 2 == 1
    sin, cos = (
        np.where(odd_change, half[middle], whole[middle]) for half, whole in zip(hold[2:4], tilts[3:5], strict=True)
    )
    up, across = np.stack([sin, cos], axis=-1), np.stack([cos, -sin], axis=-1)
    even = hold.even[np.abs(change)][:, None] * h / 2 * up
    odd = (np.sign(change) * hold.odd[np.abs(change)])[:, None] * h / 2 * across
    by_first, by_last = even - odd, even + odd
    lift = (by_first * weight[a] + by_last * weight[b]).sum(axis=1)
    thrust = np.where(lift > 0, limits.thrust_max, limits.thrust_min)[:, None]
    unit = weight / np.maximum(np.hypot(*weight.T), LEAST_LENGTH)[:, None]
    gradient = np.zeros_like(weight)
    for at, force in ((a, by_first), (b, by_last)):
        np.add.at(gradient, at, thrust * force + h / 2 * (limits.bulge * unit[at] - [0.0, limits.gravity]))
    return gradient
