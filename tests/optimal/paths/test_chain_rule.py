"""Faa di Bruno's formula against composed polynomials, whose derivatives are exact."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial import Polynomial

from optimal.paths.chain_rule import bell, composed

OUTER, INNER = Polynomial([1.0, -2.0, 0.5, 3.0, -1.0, 0.2]), Polynomial([0.3, 1.2, -0.7, 0.4])
T = np.linspace(-1.0, 1.0, 9)


@pytest.mark.parametrize("order", range(7))
def test_compositions_of_polynomials(order: int) -> None:
    outer = [OUTER.deriv(k)(INNER(T)) for k in range(order + 1)]
    inner = [INNER.deriv(k)(T) for k in range(1, order + 1)]
    exact = OUTER(INNER).deriv(order)(T)
    np.testing.assert_allclose(composed(outer, inner, order), exact, rtol=1e-10, atol=1e-9)


def test_a_composition_with_the_identity_changes_nothing() -> None:
    outer = [7.0, 5.0, 3.0, 2.0, 1.0]
    assert [composed(outer, [1.0, 0.0, 0.0, 0.0], n) for n in range(5)] == outer


@pytest.mark.parametrize("n", range(1, 7))
def test_bell_polynomials_of_ones_count_partitions(n: int) -> None:
    # Stirling numbers of the second kind, by inclusion and exclusion.
    for k in range(1, n + 1):
        stirling = sum((-1) ** (k - j) * math.comb(k, j) * j**n for j in range(k + 1)) // math.factorial(k)
        assert bell(n, k, [1] * n) == stirling


def test_symbols_agree_with_numbers() -> None:
    t = ca.SX.sym("t")
    inner, outer, rates = ca.sin(t), [ca.exp(ca.sin(t))] * 5, [ca.cos(t), -ca.sin(t), -ca.cos(t), ca.sin(t)]
    exact = ca.exp(inner)
    for n in range(5):
        gap = ca.Function("gap", [t], [composed(outer, rates, n) - exact])
        assert max(abs(float(gap(x))) for x in T) < 1e-12
        exact = ca.jacobian(exact, t)
