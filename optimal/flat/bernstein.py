"""Proven bounds of piecewise polynomials and of their quotients, from Bernstein coefficients.

On a piece, with u from 0 to 1, a polynomial of degree n is

    f(u) = sum over i = 0..n of f_i binom(n, i) u^i (1 - u)^(n-i).

This is a convex combination of the coefficients f_i, so no value exceeds the largest f_i. A quotient f/d with all
d_i > 0 is a convex combination of the f_i/d_i, with weights proportional to d_i binom(n, i) u^i (1 - u)^(n-i). Both
bounds converge with the square of the width of a piece. Pieces that may contain the maximum are bisected until bound
and attained value agree.

Rounding: every polynomial carries a bound of the error of its coefficients. Products and bisections are sums with
positive weights that add up to 1. Each of them adds at most a few units in the last place of the largest product,
times the number of terms. Bounds of values are rounded outwards by the accumulated error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array

EPS = float(np.finfo(np.float64).eps)
DERIVATIVE_ERROR = 64
"""Assumed error of the derivatives passed to `taylor`, in units in the last place."""
MAX_BISECTIONS, MAX_PIECES = 50, 20000
"""Most bisections of a piece, and most pieces considered at a time."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """Polynomials on m pieces, one for each piece.

    Attributes:
        coefficients: Bernstein coefficients of each piece, shape (m, degree + 1).
        error: bound of the error of the coefficients of each piece, shape (m,).
    """

    coefficients: Array
    error: Array

    @property
    def degree(self) -> int:
        """The degree n."""
        return self.coefficients.shape[1] - 1

    @property
    def size(self) -> Array:
        """The largest absolute coefficient of each piece, including its error, shape (m,)."""
        return np.asarray(np.abs(self.coefficients).max(axis=1) + self.error)

    def __neg__(self) -> Pieces:
        return Pieces(-self.coefficients, self.error)

    def __add__(self, other: Pieces | float) -> Pieces:
        if not isinstance(other, Pieces):
            other = constant(other, len(self.error))
        degree = max(self.degree, other.degree)
        a, b = self.raised(degree), other.raised(degree)
        return Pieces(a.coefficients + b.coefficients, a.error + b.error + EPS * (a.size + b.size))

    __radd__ = __add__

    def __sub__(self, other: Pieces | float) -> Pieces:
        return self + -other

    def __mul__(self, other: Pieces | float) -> Pieces:
        if not isinstance(other, Pieces):
            return Pieces(self.coefficients * other, (self.error + EPS * self.size) * abs(other))
        m, n = self.degree, other.degree
        a, b = self.coefficients * _binomials(m), other.coefficients * _binomials(n)
        total = np.zeros((len(a), m + n + 1))
        for i in range(m + 1):
            total[:, i : i + n + 1] += a[:, i : i + 1] * b
        rounding = (min(m, n) + 6) * EPS * self.size * other.size
        error = self.error * other.size + self.size * other.error + rounding
        return Pieces(total / _binomials(m + n), error)

    __rmul__ = __mul__

    def raised(self, degree: int) -> Pieces:
        """Return the same polynomials in the basis of a higher degree (degree elevation)."""
        if degree == self.degree:
            return self
        return self * Pieces(np.ones((len(self.error), degree - self.degree + 1)), np.zeros(len(self.error)))

    def halves(self) -> Pieces:
        """Return the left, then the right halves of all m pieces (2 m pieces), by de Casteljau's algorithm."""
        matrix = _halving(self.degree)
        left, right = self.coefficients @ matrix.T, self.coefficients[:, ::-1] @ matrix.T
        error = np.tile(self.error + (self.degree + 4) * EPS * self.size, 2)
        return Pieces(np.concatenate([left, right[:, ::-1]]), error)

    def __getitem__(self, chosen: NDArray[np.bool_]) -> Pieces:
        return Pieces(self.coefficients[chosen], self.error[chosen])


@lru_cache(maxsize=256)
def _binomials(n: int) -> Array:
    return np.array([math.comb(n, i) for i in range(n + 1)], dtype=np.float64)


@lru_cache(maxsize=256)
def _halving(n: int) -> Array:
    """Return the matrix of de Casteljau's algorithm at 1/2: row i holds binom(i, j) / 2^i."""
    rows = [[math.comb(i, j) / 2**i for j in range(n + 1)] for i in range(n + 1)]
    return np.array(rows)


def constant(value: float, count: int) -> Pieces:
    """Return a constant on `count` pieces."""
    return Pieces(np.full((count, 1), float(value)), np.zeros(count))


def taylor(derivatives: Sequence[Array], width: Array) -> Pieces:
    """Return the polynomials with given derivatives at the left ends of pieces.

    Args:
        derivatives: derivatives of order 0 to the degree, shape (m,) each, correct up to DERIVATIVE_ERROR.
        width: widths of the pieces, shape (m,).
    """
    n = len(derivatives) - 1
    terms = np.stack([d * width**i / math.factorial(i) for i, d in enumerate(derivatives)], axis=-1)
    to_bernstein = np.array([[math.comb(j, i) / math.comb(n, i) for i in range(n + 1)] for j in range(n + 1)])
    error = (DERIVATIVE_ERROR + 2 * n + 4) * EPS * np.abs(terms).sum(axis=-1)
    return Pieces(terms @ to_bernstein.T, error)


def maximum(numerator: Pieces, denominator: Pieces | None = None, tolerance: float = 1e-11) -> float:
    """Return a proven upper bound of f, or of f/d, over all pieces.

    Args:
        numerator: f.
        denominator: d, 1 by default. If d is not proven to be positive, the bound is inf.
        tolerance: greatest difference between bound and attained value at which bisection stops, relative to
            the value or to 1.
    """
    f = numerator
    d = constant(1.0, len(f.error)) if denominator is None else denominator
    degree = max(f.degree, d.degree)
    f, d = f.raised(degree), d.raised(degree)
    attained, bound = -math.inf, -math.inf
    for _ in range(MAX_BISECTIONS):
        greatest, ends = _ratios(f, d)
        attained = max(attained, float(ends.max(initial=-math.inf)))
        slack = tolerance * max(1.0, abs(attained)) if math.isfinite(attained) else 0.0
        open_ = ~(greatest <= attained + slack)
        bound = max(bound, float(greatest[~open_].max(initial=-math.inf)))
        f, d = f[open_], d[open_]
        if not open_.any() or open_.sum() > MAX_PIECES:
            break
        f, d = f.halves(), d.halves()
    remaining = _ratios(f, d)[0]
    return max(bound, math.inf if np.isnan(remaining).any() else float(remaining.max(initial=-math.inf)))


def _ratios(f: Pieces, d: Pieces) -> tuple[Array, Array]:
    """Return an upper bound of f/d on each piece, inf where d may vanish, and the greater of its two end values."""
    top = f.coefficients + f.error[:, None]
    least, most = d.coefficients - d.error[:, None], d.coefficients + d.error[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        upper = np.where(top >= 0, top / least, top / most) + 0.0
        attained = (f.coefficients / d.coefficients)[:, [0, -1]].max(axis=1)
    positive = (least > 0).all(axis=1)
    greatest = np.where(positive, upper.max(axis=1) * (1 + 2 * EPS * np.sign(upper.max(axis=1))), np.inf)
    return greatest, np.where(positive, attained, -np.inf)
