"""Paths: exact derivatives of any order, equal curves in several forms, rest at the ends, regularity inside."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from flatgym.quadrotor import Array
from optimal.paths.curves import BezierPath, BSplinePath, Path, PolynomialPath, Resting, smoothstep
from optimal.paths.regularity import require_regular

POINTS = ((0.0, 0.0, 0.0, 1.0), (1.0, 3.0, -1.0, 0.0), (2.0, -1.0, 4.0, 0.5), (5.0, 1.0, 1.0, 2.0))
"""Four points of the spatial quadrotor's outputs x, y, z, yaw."""
CUBIC = PolynomialPath(((0.0, 3.0, -1.0, 2.0), (1.0, -2.0), (0.5, 0.0, 4.0)))
PATHS: dict[str, Path] = {
    "polynomial": CUBIC,
    "bezier": BezierPath(POINTS),
    "spline": BSplinePath((*POINTS, *POINTS, *POINTS), 5),
    "uneven spline": BSplinePath((*POINTS, *POINTS), 5, (0, 0, 0, 0, 0, 0, 0.2, 0.7, 1, 1, 1, 1, 1, 1)),
    "resting polynomial": Resting(CUBIC, 3),
    "resting spline": Resting(BSplinePath((*POINTS, *POINTS), 5), 2),
}


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
def test_derivatives_agree_with_finite_differences(path: Path, order: int) -> None:
    s, h = np.linspace(0.013, 0.987, 40), 1e-5
    difference = (path(s + h, order - 1) - path(s - h, order - 1)) / (2 * h)
    np.testing.assert_allclose(difference, path(s, order), atol=1e-5 * np.abs(path(s, order)).max() + 1e-9)


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
def test_batched_values_equal_single_values(path: Path) -> None:
    s = np.linspace(0, 1, 6).reshape(2, 3)
    coordinates = path(0.3).shape[0]
    assert path(s, 2).shape == (2, 3, coordinates)
    np.testing.assert_allclose(path(s, 3)[1, 2], path(s[1, 2], 3), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
def test_orders_beyond_the_degree_are_zero_and_negative_ones_refused(path: Path) -> None:
    if not isinstance(path, Resting):
        np.testing.assert_array_equal(path([0.0, 0.4, 1.0], 7), 0)
    with pytest.raises(ValueError, match="at least 0, got -1"):
        path(0.5, -1)


def test_a_bezier_curve_is_its_bernstein_polynomial_and_a_spline_without_inner_knots() -> None:
    s = Polynomial([0.0, 1.0])
    rows = sum(np.outer(p, np.pad((math.comb(3, j) * s**j * (1 - s) ** (3 - j)).coef, (0, 0)))
               for j, p in enumerate(POINTS))  # fmt: skip
    same = [BezierPath(POINTS), BSplinePath(POINTS, 3), PolynomialPath(tuple(map(tuple, rows)))]
    for order in range(5):
        first, *others = (path(np.linspace(0, 1, 9), order) for path in same)
        for other in others:
            np.testing.assert_allclose(other, first, atol=1e-11)


def test_a_spline_stays_in_the_hull_of_its_points_and_interpolates_the_outer_ones() -> None:
    spline = BSplinePath((*POINTS, *POINTS, *POINTS), 5)
    low, high = np.min(POINTS, axis=0), np.max(POINTS, axis=0)
    assert ((spline(np.linspace(0, 1, 501)) >= low) & (spline(np.linspace(0, 1, 501)) <= high)).all()
    np.testing.assert_allclose(spline([0.0, 1.0]), [POINTS[0], POINTS[-1]], atol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_resting_agrees_with_the_expanded_composition(order: int) -> None:
    expanded = [Polynomial(row)(smoothstep(order)) for row in CUBIC.coefficients]
    s = np.linspace(0, 0.5, 21)  # further on the expansion's large coefficients of both signs cost it digits
    for derivative in range(6):
        expected = np.stack([p.deriv(derivative)(s) for p in expanded], axis=-1)
        np.testing.assert_allclose(
            Resting(CUBIC, order)(s, derivative), expected, atol=1e-10 * max(1, np.abs(expected).max())
        )


@pytest.mark.parametrize("order", [2, 3, 4])
def test_resting_curves_are_at_rest_at_both_ends_and_run_through_the_same_points(order: int) -> None:
    path, resting = PATHS["bezier"], Resting(PATHS["bezier"], order)
    for derivative in range(1, order):
        np.testing.assert_allclose(resting([0.0, 1.0], derivative), 0, atol=1e-9)
    assert np.abs(resting([0.0, 1.0], order)).min() > 0.1
    np.testing.assert_allclose(resting([0.0, 0.5, 1.0]), path([0.0, 0.5, 1.0]), atol=1e-12)


def test_smoothsteps_are_the_printed_ones() -> None:
    np.testing.assert_allclose(smoothstep(3).coef, [0, 0, 0, 10, -15, 6], atol=1e-12)
    np.testing.assert_allclose(smoothstep(2).coef, [0, 0, 3, -2], atol=1e-12)
    with pytest.raises(ValueError, match="at least 1"):
        smoothstep(0)
    with pytest.raises(ValueError, match="at least 1"):
        Resting(CUBIC, 0)


def test_equal_paths_are_equal_values() -> None:
    assert BSplinePath(POINTS, 2) == BSplinePath(POINTS, 2) != BSplinePath(POINTS, 3)
    assert len({BezierPath(POINTS), BezierPath(POINTS), PolynomialPath(((0, 1),))}) == 2


@pytest.mark.parametrize("order", [1, 2, 3])
def test_regular_curves_may_rest_at_their_ends(order: int) -> None:
    require_regular(Resting(CUBIC, order))


@pytest.mark.parametrize(
    ("path", "fault"),
    [
        (PolynomialPath(((0.0, -0.6, 1.0), (0.0, -1.2, 2.0))), "0.3"),
        (Resting(PolynomialPath(((0.0, -1.0, 1.0),)), 3), "0.5"),
        (PolynomialPath(((0.0, 3 / 16, -3 / 4, 1.0),)), "0.25"),
        (PolynomialPath(((1.0,), (2.0,))), "0.0005"),
        (BSplinePath(((0, 0), (1, 0), (1, 0), (1, 0), (1, 0), (2, 1)), 2), "0.25"),
    ],
)
def test_paths_that_stand_still_inside_are_refused_naming_s(path: Path, fault: str) -> None:
    with pytest.raises(ValueError, match=f"degenerate.* s = {fault}"):
        require_regular(path)


def test_paths_that_are_not_finite_are_refused() -> None:
    class Lost:
        def __call__(self, s: ArrayLike, order: int = 0) -> Array:
            return np.full((*np.shape(s), 2), np.nan * order)

    with pytest.raises(ValueError, match="not finite at s = 0"):
        require_regular(Lost())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PolynomialPath(()), "one row for each coordinate"),
        (lambda: PolynomialPath(((1.0,), ())), "one row for each coordinate"),
        (lambda: PolynomialPath(((1.0, math.nan),)), "PolynomialPath.coefficients must be finite"),
        (lambda: BezierPath(((0.0, 1.0),)), "at least two, got 1"),
        (lambda: BezierPath(((0.0, 1.0), (0.0, math.inf))), "BezierPath.points must be rows of finite"),
        (lambda: BezierPath(((0.0, 1.0), (0.0,))), "rows of equal length"),
        (lambda: BSplinePath(POINTS), "below the 4 points, got 5"),
        (lambda: BSplinePath(POINTS, 0), "at least 1"),
        (lambda: BSplinePath(POINTS, 3, (0, 0, 1, 1)), "must be 8 for 4 points of degree 3, got 4"),
        (lambda: BSplinePath(POINTS, 2, (0, 0, 0, 0, 1, 1, 1)), "must not decrease"),
        (lambda: BSplinePath((*POINTS, *POINTS), 5, (0,) * 6 + (0.7, 0.2) + (1,) * 6), "must not decrease"),
    ],
)
def test_bad_values_are_refused_by_name(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=message):
        make()
