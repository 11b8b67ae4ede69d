"""Spline spaces with double knots: partition of unity, continuity, and exact refinement."""

from __future__ import annotations

import numpy as np
import pytest

from flatgym.quadrotor import Array
from optimal.flat.splines import SplineSpace

UNIFORM, UNEVEN = np.linspace(0, 1, 7), np.array([0.0, 0.05, 0.3, 0.35, 0.8, 1.0])
SPACES = [SplineSpace(nodes, degree, 2) for nodes in (UNIFORM, UNEVEN) for degree in (2, 3, 4, 5)]
IDS = [f"{len(space.nodes) - 1} intervals, degree {space.degree}" for space in SPACES]


def inside(space: SplineSpace, count: int = 11) -> tuple[Array, Array]:
    """Return intervals and coordinates within them, both ends included."""
    share = np.linspace(0, 1, count)
    s = space.nodes[:-1, None] + np.diff(space.nodes)[:, None] * share
    return np.repeat(np.arange(len(space.nodes) - 1), count), s.ravel()


@pytest.mark.parametrize("space", SPACES, ids=IDS)
def test_the_basis_is_a_partition_of_unity(space: SplineSpace) -> None:
    basis = space.basis(*inside(space), 0)
    assert basis.min() >= 0
    np.testing.assert_allclose(basis.sum(axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(space.basis(*inside(space), 1).sum(axis=1), 0, atol=1e-9)


@pytest.mark.parametrize("space", SPACES, ids=IDS)
def test_local_bases_add_up_to_the_global_spline(space: SplineSpace, generator: np.random.Generator) -> None:
    coefficients = generator.normal(size=space.size)
    interval, s = inside(space)
    within = np.clip(s, space.nodes[interval], np.nextafter(space.nodes[interval + 1], -1))
    for order in range(space.degree + 1):
        local = (space.basis(interval, s, order) * coefficients[space.local(interval)]).sum(axis=1)
        exact = space.spline(coefficients)(within, nu=order)
        np.testing.assert_allclose(local, exact, atol=1e-12 * (1 + np.abs(exact).max()))


@pytest.mark.parametrize("space", SPACES, ids=IDS)
def test_all_but_the_two_highest_derivatives_are_continuous(space: SplineSpace, generator: np.random.Generator) -> None:
    spline, nodes = space.spline(generator.normal(size=space.size)), space.nodes[1:-1]
    for order in range(space.degree + 1):
        before, after = spline(np.nextafter(nodes, 0), nu=order), spline(nodes, nu=order)
        jump = np.abs(after - before) / np.abs(after).max()
        assert jump.max() < 1e-9 if order <= space.degree - 2 else jump.min() > 1e-3


@pytest.mark.parametrize("space", SPACES, ids=IDS)
def test_centres_as_coefficients_give_the_identity(space: SplineSpace) -> None:
    _, s = inside(space)
    np.testing.assert_allclose(space.spline(space.centres)(s), s, atol=1e-13)


@pytest.mark.parametrize("space", SPACES, ids=IDS)
def test_on_a_nested_grid_a_spline_is_fitted_exactly(space: SplineSpace, generator: np.random.Generator) -> None:
    spline = space.spline(generator.normal(size=(space.size, 2)))
    halves = (space.nodes[1:] + space.nodes[:-1]) / 2
    finer = SplineSpace(np.sort(np.concatenate([space.nodes, halves[::2]])), space.degree, 2)
    fitted = finer.spline(finer.fitted(spline))
    s = np.linspace(0, 1, 501)
    np.testing.assert_allclose(fitted(s), spline(s), atol=1e-11)


def test_coefficients_within_bounds_keep_the_spline_there_everywhere(generator: np.random.Generator) -> None:
    space = SplineSpace(UNEVEN, 4, 2)
    values = space.spline(generator.integers(0, 2, size=(space.size, 50)).astype(float))(np.linspace(0, 1, 2001))
    assert values.min() >= 0
    assert values.max() <= 1 + 1e-15


def test_the_size_is_the_number_of_coefficients_a_spline_takes() -> None:
    for space in SPACES:
        assert len(space.knots) == space.size + space.degree + 1
        assert space.local(np.arange(len(space.nodes) - 1)).max() == space.size - 1
