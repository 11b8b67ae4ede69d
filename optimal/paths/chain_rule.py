"""Derivatives of composed functions: Faa di Bruno's formula.

    d^n g(h(t)) / dt^n = sum over k of g^(k)(h(t)) B_nk(h', h'', ...),

with the partial Bell polynomials B_nk = sum over i of binom(n-1, i-1) x_i B_(n-i)(k-1), B_00 = 1. A path travelled in
time is such a composition (paper eqs. (6) and (9)), and so is a reparametrised path. The functions accept numbers,
arrays and symbols.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import Any


def composed(outer: Sequence[Any], inner: Sequence[Any], order: int) -> Any:
    """Return the derivative of g(h(t)) of the given order.

    Args:
        outer: g, g', g'', ... at h(t), at least up to the order.
        inner: h', h'', ... at t, at least up to the order.
        order: order of the derivative; 0 for the value.
    """
    if order == 0:
        return outer[0]
    return sum(outer[k] * bell(order, k, inner) for k in range(1, order + 1))


def bell(n: int, k: int, x: Sequence[Any]) -> Any:
    """Return the partial Bell polynomial B_nk(x[0], x[1], ...)."""
    if n == 0 or k == 0:
        return 1 if n == k else 0
    return sum(comb(n - 1, i - 1) * x[i - 1] * bell(n - i, k - 1, x) for i in range(1, n - k + 2))
