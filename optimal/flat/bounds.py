"""Proven bounds of thrust, rate and position of a flat motion of the planar quadrotor, in continuous time.

Outer paths y_i(s), weights p_i(s) and squared speed b(s) are polynomials between the nodes and the knots of the paths.
With ' = d/ds and the z axis upwards, the following are polynomials too:

    A  = y'' b + y' b'/2 + (0, g),                thrust^2 = |A|^2,
    A' = y''' b + 3/2 y'' b' + y' b''/2,          rate^2 = b (A_x' A_z - A_x A_z')^2 / |A|^4.

Their Bernstein coefficients bound them (`optimal.flat.bernstein`). No bound is proven, and the range is infinite, for
a path that is not a piecewise polynomial, if b is not proven to be positive, or if A jumps between pieces. A jump of A
would turn the tilt at an infinite rate.
"""

from __future__ import annotations

import math
from functools import reduce
from operator import add
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import brentq

from flatgym.quadrotor import Array
from optimal.flat.bernstein import Pieces, constant, maximum, taylor
from optimal.paths.chain_rule import composed
from optimal.paths.curves import BezierPath, BSplinePath, Path, PolynomialPath, Resting, smoothstep

JUMP = 1e-9
"""Difference of the thrust vectors of two adjacent pieces, relative to their length, that counts as rounding."""
UNKNOWN = np.array([[-math.inf, -math.inf], [math.inf, math.inf]])


class FlatMotion(Protocol):
    """The data of a flat motion that the bounds need. `optimal.flat.trajectory.FlatTrajectory` provides them."""

    @property
    def outer_paths(self) -> tuple[Path, ...]:
        """The k paths y_i(s), s from 0 to 1."""

    @property
    def nodes(self) -> Array:
        """Path coordinates between which all functions are smooth, from 0 to 1, shape (N + 1,)."""

    @property
    def weights(self) -> BSpline:
        """The first k - 1 weights p_i(s), a spline of shape (..., k - 1)."""

    @property
    def squared_speed(self) -> BSpline:
        """b(s) [1/s^2], a spline."""


def control_range(flight: FlatMotion, gravity: float) -> Array:
    """Return proven least and greatest [thrust, rate] of a planar motion, shape (2, 2); infinite if not proven.

    Args:
        flight: the motion.
        gravity: gravitational acceleration [m/s^2].
    """
    ends = knots(flight)
    if ends is None:
        return UNKNOWN
    begin, width = ends[:-1], np.diff(ends)
    path = path_pieces(flight, begin, width)
    b, slope, bend = (spline_pieces(flight.squared_speed, k, begin, width) for k in range(3))
    if not maximum(-b) < 0:
        return UNKNOWN
    ahead = [second * b + first * slope * 0.5 for first, second in zip(path[1], path[2], strict=True)]
    ahead[1] = ahead[1] + gravity
    turned = [
        third * b + second * slope * 1.5 + first * bend * 0.5
        for first, second, third in zip(path[1], path[2], path[3], strict=True)
    ]
    square = ahead[0] * ahead[0] + ahead[1] * ahead[1]
    cross = turned[0] * ahead[1] - ahead[0] * turned[1]
    rate = _root(maximum(b * cross * cross, square * square)) if _continuous(ahead) else math.inf
    return np.array([[_root(-maximum(-square)), -rate], [_root(maximum(square)), rate]])


def support_bound(flight: FlatMotion, direction: Array) -> float:
    """Return a proven upper bound of y . direction over a motion [m]; inf if not proven."""
    if (ends := knots(flight)) is None:
        return math.inf
    x, z = path_pieces(flight, ends[:-1], np.diff(ends), 0)[0]
    return maximum(x * float(direction[0]) + z * float(direction[1]))


def distance_bound(flight: FlatMotion, point: Array) -> float:
    """Return a proven lower bound of |y - point| over a motion [m]; 0 if not proven."""
    if (ends := knots(flight)) is None:
        return 0.0
    x, z = path_pieces(flight, ends[:-1], np.diff(ends), 0)[0]
    x, z = x - float(point[0]), z - float(point[1])
    return _root(-maximum(-(x * x + z * z)))


def _root(square: float) -> float:
    """Return the square root of a bound of a square, which rounding may have made negative."""
    return math.sqrt(max(square, 0.0))


def _continuous(ahead: list[Pieces]) -> bool:
    """Return whether the thrust vectors of adjacent pieces agree at their common end."""
    jumps = [part.coefficients[1:, 0] - part.coefficients[:-1, -1] for part in ahead]
    length = np.hypot(*(part.coefficients[1:, 0] for part in ahead))
    return bool((np.hypot(*jumps) <= JUMP * length).all())


def knots(flight: FlatMotion) -> Array | None:
    """Return the path coordinates between which all functions are polynomials; None if a path is not piecewise
    polynomial.
    """
    path_knots = [_path_knots(path) for path in flight.outer_paths]
    if any(k is None for k in path_knots):
        return None
    inside = [k for k in path_knots if k is not None]
    splines = [flight.weights.t, flight.squared_speed.t] if len(path_knots) > 1 else [flight.squared_speed.t]
    every = np.unique(np.concatenate([flight.nodes, *inside, *splines]))
    return np.asarray(every[(every >= 0) & (every <= 1)])


def _path_knots(path: Path) -> Array | None:
    """Return the knots of a path in s; None if the path is not known to be piecewise polynomial."""
    if isinstance(path, PolynomialPath | BezierPath):
        return np.array([0.0, 1.0])
    if isinstance(path, BSplinePath):
        return np.asarray(path._spline.t)
    if (
        isinstance(path, Resting)
        and not isinstance(path.path, Resting)
        and (inner := _path_knots(path.path)) is not None
    ):
        q = smoothstep(path.order)
        within = inner[(inner > 0) & (inner < 1)]
        return np.array([0.0, *(brentq(lambda s, k=k: q(s) - k, 0.0, 1.0, xtol=1e-16) for k in within), 1.0])
    return None


def _degree(path: Path) -> int:
    """Return the degree of the polynomial pieces of a path."""
    if isinstance(path, PolynomialPath):
        return max(len(row) for row in path.coefficients) - 1
    if isinstance(path, BezierPath):
        return len(path.points) - 1
    if isinstance(path, BSplinePath):
        return path.degree
    raise TypeError(f"a {type(path).__name__} is not known to be a piecewise polynomial")


def path_pieces(flight: FlatMotion, begin: Array, width: Array, order: int = 3) -> list[list[Pieces]]:
    """Return y and its s-derivatives up to an order, each as a list of coordinates, by Leibniz' rule."""
    orders = range(order + 1)
    last = [outer_pieces(flight.outer_paths[-1], k, begin, width) for k in orders]
    derivatives = [list(coordinates) for coordinates in last]
    for i, path in enumerate(flight.outer_paths[:-1]):
        apart = [
            [mine - other for mine, other in zip(outer_pieces(path, k, begin, width), last[k], strict=True)]
            for k in orders
        ]
        weight = BSpline(flight.weights.t, flight.weights.c[..., i], flight.weights.k)
        share = [spline_pieces(weight, k, begin, width) for k in orders]
        for o in orders:
            for c in range(len(derivatives[o])):
                terms = [share[k] * apart[o - k][c] * float(math.comb(o, k)) for k in range(o + 1)]
                derivatives[o][c] = reduce(add, terms, derivatives[o][c])
    return derivatives


def outer_pieces(path: Path, order: int, begin: Array, width: Array) -> list[Pieces]:
    """Return the derivative of an outer path of the given order with respect to s, one entry for each coordinate."""
    if isinstance(path, Resting):
        return _composed(path, order, begin, width)
    derivatives = [path(begin, k) for k in range(order, max(order, _degree(path)) + 1)]
    return [taylor([d[..., c] for d in derivatives], width) for c in range(derivatives[0].shape[-1])]


def spline_pieces(spline: BSpline, order: int, begin: Array, width: Array) -> Pieces:
    """Return the derivative of a scalar spline of the given order as pieces.

    Repeated differences of its coefficients lose fewer digits than derivatives of the basis functions.
    """
    derivatives, t, c = [], spline.t, spline.c
    for degree in range(spline.k, -1, -1):
        derivatives.append(BSpline(t, c, degree)(begin))
        span = t[degree + 1 : -1] - t[1 : -degree - 1]
        # Between coinciding knots there is no piece on which the coefficient is active.
        c = np.diff(c) * degree / np.where(span > 0, span, 1.0)
        t = t[1:-1]
    return taylor(derivatives[order:] or [np.zeros_like(begin)], width)


def _composed(path: Resting, order: int, begin: Array, width: Array) -> list[Pieces]:
    """Return the derivative of y(q(s)) by Faa di Bruno's formula; Horner's rule sums the Taylor series of y."""
    q = smoothstep(path.order)
    inner = [taylor([q.deriv(i)(begin) for i in range(k, q.degree() + 1)], width) for k in range(order + 1)]
    at = np.clip(q(begin), 0.0, 1.0)
    ahead = inner[0] + Pieces(-at[:, None], np.zeros(len(at)))
    degree = _degree(path.path)
    outer = [path.path(at, k) for k in range(degree + 1)]

    def coordinate(c: int) -> Pieces:
        parts = []
        for k in range(order + 1):
            total = constant(0.0, len(at))
            for j in range(degree, k - 1, -1):
                value = outer[j][:, c] / math.factorial(j - k)
                total = total * ahead + Pieces(value[:, None], 64 * np.finfo(np.float64).eps * np.abs(value))
            parts.append(total)
        derivative = composed(parts, inner[1:], order)
        return derivative if isinstance(derivative, Pieces) else constant(float(derivative), len(at))

    return [coordinate(c) for c in range(outer[0].shape[-1])]
