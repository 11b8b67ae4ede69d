"""Bernstein bounds: never below a value, close to the maximum, and exact for known maxima."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.polynomial import polynomial as poly

from optimal.flat.bernstein import Pieces, constant, maximum, taylor


def pieces(coefficients: np.ndarray) -> Pieces:
    """Return polynomials on [0, 1] from power coefficients, constant term first, shape (m, degree + 1)."""
    derivatives = [math.factorial(k) * coefficients[:, k] for k in range(coefficients.shape[1])]
    return taylor(derivatives, np.ones(len(coefficients)))


def greatest(coefficients: np.ndarray) -> float:
    """Return the greatest value on [0, 1], from the roots of the derivative."""
    inner = poly.polyroots(poly.polyder(coefficients))
    inner = inner[np.abs(inner.imag) < 1e-9].real
    return float(poly.polyval(np.concatenate([[0.0, 1.0], inner[(inner > 0) & (inner < 1)]]), coefficients).max())


@pytest.mark.parametrize("degree", [1, 2, 5, 9])
def test_bounds_are_tight_and_never_below_a_value(generator, degree):
    u = np.linspace(0, 1, 2001)
    for _ in range(20):
        c = generator.normal(size=degree + 1)
        bound = maximum(pieces(c[None]))
        assert bound >= poly.polyval(u, c).max()
        assert bound == pytest.approx(greatest(c), abs=1e-9)


def test_the_maximum_over_many_pieces_is_that_of_the_largest(generator):
    c = generator.normal(size=(30, 6))
    assert maximum(pieces(c)) == pytest.approx(max(map(greatest, c)), abs=1e-9)


def test_known_maxima():
    # 4 u (1 - u) and a needle 10^-3 wide, (1 - (u - 0.37)^2 / w^2), each 1 at the top.
    assert maximum(pieces(np.array([[0.0, 4.0, -4.0]]))) == pytest.approx(1.0, abs=1e-10)
    w = 5e-4
    needle = np.array([[1 - 0.37**2 / w**2, 2 * 0.37 / w**2, -1 / w**2]])
    assert maximum(pieces(needle)) == pytest.approx(1.0, abs=1e-6)  # of coefficients of 10^6
    assert maximum(pieces(needle)) >= 1.0
    assert maximum(constant(2.5, 3)) == pytest.approx(2.5, rel=1e-14)


def test_sums_and_products_are_those_of_polynomials(generator):
    a, b = generator.normal(size=4), generator.normal(size=7)
    product = pieces(a[None]) * pieces(b[None])
    exact = pieces(poly.polymul(a, b)[None])
    np.testing.assert_allclose(product.coefficients, exact.coefficients, atol=1e-13)
    assert np.all(np.abs(product.coefficients - exact.coefficients) <= product.error + exact.error)
    total = pieces(a[None]) - pieces(b[None])
    np.testing.assert_allclose(total.coefficients, pieces(poly.polysub(a, b)[None]).coefficients, atol=1e-13)


def test_halves_are_the_same_polynomial(generator):
    c = generator.normal(size=8)
    left, right = pieces(c[None]).halves().coefficients
    half = poly.polyval(0.5, c)
    np.testing.assert_allclose([left[0], left[-1], right[0], right[-1]], [c[0], half, half, c.sum()], atol=1e-13)
    halved = np.array([c * 0.5 ** np.arange(8)])
    np.testing.assert_allclose(left, pieces(halved).coefficients[0], atol=1e-13)


def test_quotients_are_bounded(generator):
    u = np.linspace(0, 1, 4001)
    for _ in range(20):
        f, d = generator.normal(size=6), np.append(1.0, 0.1 * generator.normal(size=4))
        bound, values = maximum(pieces(f[None]), pieces(d[None])), poly.polyval(u, f) / poly.polyval(u, d)
        assert values.max() <= bound <= values.max() + 1e-5
    # u / (1 + u) grows to 1/2.
    assert maximum(pieces(np.array([[0.0, 1.0]])), pieces(np.array([[1.0, 1.0]]))) == pytest.approx(0.5, abs=1e-11)


def test_a_vanishing_denominator_gives_an_infinite_bound():
    assert maximum(constant(1.0, 1), pieces(np.array([[-0.3, 1.0]]))) == math.inf


def test_errors_widen_the_bound():
    uncertain = Pieces(np.array([[1.0, 2.0, 1.0]]), np.array([0.01]))
    assert maximum(uncertain) >= 1.5 + 0.01
