"""Paths: curves y(s), s in [0, 1], with exact derivatives of any order, in any number of coordinates.

Eqs. (6) and (9) project a flat system onto a path through the derivatives of y with respect to s. A path answers one
call, `path(s, order)`, shape (..., n): n = 2 for the planar quadrotor (x, z), n = 4 for the full quadrotor
(x, y, z, yaw).

A flight from rest to rest needs y^(l) = 0 at both ends for l = 1, ..., beta - 1 (section II-E). `Resting` gives any
curve this property by the reparametrisation y(q(s)), where

    q(s) = sum over j = n..2n-1 of binom(2n-1, j) s^j (1 - s)^(2n-1-j)

is the smoothstep of degree 2n - 1. Its derivatives of orders 1 to n - 1 vanish at 0 and 1. It is the q(s) of section
III for n = 3, and the r(s) for n = 2. The derivatives of y(q(s)) follow from Faa di Bruno's formula
(`optimal.paths.chain_rule`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline

from flatgym.quadrotor import Array
from optimal.paths.chain_rule import composed

Points = tuple[tuple[float, ...], ...]
"""Rows of finite numbers."""


class Path(Protocol):
    """A curve that answers `path(s, order)` with positions or exact derivatives, shape (..., n)."""

    def __call__(self, s: ArrayLike, order: int = 0) -> Array: ...


@lru_cache(maxsize=16)
def smoothstep(order: int) -> Polynomial:
    """Return the smoothstep: the polynomial of degree 2 order - 1 that rises from 0 to 1 with rest at both ends.

    Args:
        order: derivatives of orders 1 to order - 1 vanish at 0 and 1; 2 gives the paper's r(s), 3 its q(s).

    Raises:
        ValueError: for an order below 1.
    """
    if order < 1:
        raise ValueError(f"order of a smoothstep must be at least 1 (a straight line), got {order}")
    degree, s = 2 * order - 1, Polynomial([0.0, 1.0])
    return sum((math.comb(degree, j) * s**j * (1 - s) ** (degree - j) for j in range(order, degree + 1)), 0 * s)


@dataclass(frozen=True)
class PolynomialPath:
    """A path whose coordinates are polynomials of s.

    Attributes:
        coefficients: one row for each coordinate, constant term first; rows may differ in length.

    Raises:
        ValueError: for no coordinates, an empty row, or values that are not finite.
    """

    coefficients: Points

    def __post_init__(self) -> None:
        rows = tuple(_finite("PolynomialPath.coefficients", row) for row in self.coefficients)
        if not rows or not all(rows):
            raise ValueError(
                f"PolynomialPath.coefficients must be one row for each coordinate, got {self.coefficients!r}"
            )
        object.__setattr__(self, "coefficients", rows)

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Return the derivative of the given order with respect to s, shape (..., n)."""
        _require_order(order)
        s = np.asarray(s, dtype=np.float64)
        return np.stack([polyval(s, _derivative(row, order)) for row in self.coefficients], axis=-1)


@lru_cache(maxsize=256)
def _derivative(coefficients: tuple[float, ...], order: int) -> Array:
    """Return the coefficients of a derivative of a polynomial, constant term first."""
    if order >= len(coefficients):
        return np.zeros(1)
    return np.asarray(polyder(coefficients, order), dtype=np.float64)


@dataclass(frozen=True)
class BSplinePath:
    """A clamped B-spline. Each of its pieces lies in the convex hull of degree + 1 consecutive control points.

    Attributes:
        points: control points, m rows of n coordinates; the first and the last are the ends of the path.
        degree: degree of the polynomial pieces; derivatives below this order are continuous at simple knots.
        knots: m + degree + 1 values from 0 to 1, each end repeated degree + 1 times; evenly spaced by default.

    Raises:
        ValueError: for points or knots that do not define a clamped B-spline.
    """

    points: Points
    degree: int = 5
    knots: tuple[float, ...] | None = None
    _spline: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        points = _rows("BSplinePath.points", self.points)
        if self.degree < 1 or len(points) <= self.degree:
            raise ValueError(
                f"BSplinePath.degree must be at least 1 and below the {len(points)} points, got {self.degree}"
            )
        if self.knots is None:
            knots = clamped_knots(len(points), self.degree)
        else:
            knots = np.array(_finite("BSplinePath.knots", self.knots))
            object.__setattr__(self, "knots", tuple(knots.tolist()))
            self._require_clamped(knots, len(points))
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "_spline", BSpline(knots, np.array(points), self.degree))

    def _require_clamped(self, knots: Array, count: int) -> None:
        ends = self.degree + 1
        if len(knots) != count + ends:
            raise ValueError(
                f"BSplinePath.knots must be {count + ends} for {count} points of degree {self.degree}, got {len(knots)}"
            )
        inside = knots[ends:-ends]
        clamped = not knots[:ends].any() and (knots[-ends:] == 1).all() and ((inside > 0) & (inside < 1)).all()
        if not clamped or (np.diff(knots) < 0).any():
            raise ValueError(
                f"BSplinePath.knots must not decrease, and must be 0 and 1 exactly {ends} times each, at the ends, "
                f"got {self.knots}"
            )

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Return the derivative of the given order with respect to s, shape (..., n)."""
        _require_order(order)
        s = np.asarray(s, dtype=np.float64)
        return np.asarray(self._spline(s, nu=min(order, self.degree + 1)))


@dataclass(frozen=True)
class BezierPath:
    """A Bezier curve, which is the B-spline without inner knots: y(s) = sum of binom(m, j) s^j (1 - s)^(m-j) P_j.

    Attributes:
        points: control points P_0, ..., P_m, rows of n coordinates.

    Raises:
        ValueError: for fewer than two points, rows of different lengths, or values that are not finite.
    """

    points: Points
    _spline: BSplinePath = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        points = _rows("BezierPath.points", self.points)
        if len(points) < 2:
            raise ValueError(f"BezierPath.points must be at least two, got {len(points)}")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "_spline", BSplinePath(points, len(points) - 1))

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Return the derivative of the given order with respect to s, shape (..., n)."""
        return self._spline(s, order)


@dataclass(frozen=True)
class Resting:
    """A curve reparametrised for rest at both ends: y(q(s)), q the smoothstep.

    Attributes:
        path: the curve y.
        order: derivatives of y(q(s)) of orders 1 to order - 1 vanish at both ends.

    Raises:
        ValueError: for an order below 1.
    """

    path: Path
    order: int = 3

    def __post_init__(self) -> None:
        smoothstep(self.order)

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        """Return the derivative of the given order with respect to s, shape (..., n), by Faa di Bruno's formula."""
        _require_order(order)
        s = np.asarray(s, dtype=np.float64)
        q = smoothstep(self.order)
        within = np.clip(q(s), 0.0, 1.0)
        inner = [q.deriv(i)(s)[..., None] for i in range(1, order + 1)]
        return np.asarray(composed([self.path(within, k) for k in range(order + 1)], inner, order))


def clamped_knots(count: int, degree: int) -> Array:
    """Return evenly spaced knots on [0, 1] for `count` control points, ends repeated degree + 1 times."""
    return np.concatenate([np.zeros(degree), np.linspace(0.0, 1.0, count - degree + 1), np.ones(degree)])


def _require_order(order: int) -> None:
    if order < 0:
        raise ValueError(f"order of a derivative must be at least 0, got {order}")


def _finite(name: str, values: ArrayLike) -> tuple[float, ...]:
    """Return finite numbers as a tuple, or raise ValueError with the name."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite numbers, got {values!r}")
    return tuple(array.tolist())


def _rows(name: str, values: ArrayLike) -> Points:
    """Return rows of finite coordinates as tuples, or raise ValueError with the name."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except ValueError:
        raise ValueError(f"{name} must be rows of equal length, got {values!r}") from None
    if array.ndim != 2 or 0 in array.shape or not np.isfinite(array).all():
        raise ValueError(f"{name} must be rows of finite coordinates, shape (m, n), got {values!r}")
    return tuple(map(tuple, array.tolist()))
