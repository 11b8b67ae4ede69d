"""Separating multipliers are found if they exist, also from poor starts, and are never claimed otherwise."""

from functools import cache

import numpy as np
import pytest

from flatgym import SCENARIOS
from optimal.direct.shooting import solve_winding
from optimal.proof.branches import Branch
from optimal.proof.bundle_method import MAX_EVALUATIONS, separate
from optimal.proof.dual import Cut, Dual
from optimal.proof.initial_multipliers import kink_shares, multipliers
from optimal.proof.programme.stations import Problem
from optimal.proof.programme.time_grid import time_grid

NAMES = ("horizontal-6", "diagonal", "ground-6")


@cache
def problem(name: str, share: float) -> tuple[Dual, np.ndarray]:
    """Return the dual of winding 0 at a share of the best known time, and the multipliers of that flight."""
    scenario = SCENARIOS[name]
    shot = solve_winding(scenario)
    kinks = kink_shares(scenario, shot)
    grid = time_grid(share * shot.trajectory.duration, scenario.quadrotor.rate_max, turn=200)
    return Dual(Problem(scenario, None, grid.time, kinks), grid, Branch(0)), multipliers(scenario, shot, kinks)


def perturbed(dual: Dual, start: np.ndarray, generator, spread: float) -> np.ndarray:
    y = start / np.linalg.norm(start) + spread * generator.normal(size=dual.size)
    y[dual.signed] = np.abs(y[dual.signed])
    return y


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("share", [0.9, 0.99])
def test_a_time_too_short_is_separated_from_poor_starts(name, share, generator):
    dual, costates = problem(name, share)
    for spread in (0.0, 0.03, 0.1, 0.3):
        found = separate(dual, [perturbed(dual, costates, generator, spread)])
        assert found.value < 0
        assert 1 <= found.evaluations <= MAX_EVALUATIONS


@pytest.mark.parametrize("name", NAMES)
def test_a_time_long_enough_is_never_separated(name, generator):
    dual, costates = problem(name, 1.01)
    for spread in (0.0, 0.1, 1.0):
        assert separate(dual, [perturbed(dual, costates, generator, spread)]).value >= 0


def test_the_result_is_the_dual_value_at_unit_multipliers_of_the_right_sign(generator):
    for share in (0.97, 1.01):
        dual, costates = problem("ground-6", share)
        for spread in (0.1, 1.0):
            found = separate(dual, [perturbed(dual, costates, generator, spread)])
            assert found.value == sum(dual(found.multipliers)[:2])
            assert np.linalg.norm(found.multipliers) == pytest.approx(1.0, rel=1e-12)
            assert (found.multipliers[dual.signed] >= 0).all()


def test_more_evaluations_never_give_a_worse_value(generator):
    dual, costates = problem("horizontal-6", 1.005)
    start = perturbed(dual, costates, generator, 0.3)
    values = [separate(dual, [start], steps).value for steps in (1, 2, 5, 10, 20)]
    assert (np.diff(values) <= 0).all()
    assert values[-1] < 0.2 * values[0]


def test_the_length_of_the_start_does_not_matter(generator):
    dual, costates = problem("horizontal-6", 0.99)
    start = perturbed(dual, costates, generator, 0.2)
    values = [separate(dual, [factor * start], 3).value for factor in (1e-3, 1.0, 1e3)]
    assert values == pytest.approx([values[0]] * 3, rel=1e-6)


class Polyhedron:
    """The support function of the convex hull of points, as a dual."""

    def __init__(self, points, signed=()) -> None:
        self.points, self.size, self.signed = np.array(points), len(points[0]), np.array(signed, dtype=int)

    def __call__(self, y):
        best = self.points[np.argmax(self.points @ y)]
        return Cut(float(best @ y), 0.0, best)


def test_a_separating_plane_is_found_if_and_only_if_it_exists(generator):
    for size in (2, 4):
        for _ in range(20):
            points, start = generator.normal(size=(12, size)), generator.normal(size=size)
            away = points + 1.2 * np.abs(points).max() * np.eye(size)[0] * np.sqrt(size)
            assert separate(Polyhedron(away), [start]).value < 0
            around = np.vstack([points, -points])
            assert separate(Polyhedron(around), [start]).value >= 0


def test_signed_multipliers_restrict_the_planes(generator):
    # The hull lies at y_0 = 1. A plane with y_0 < 0 separates it from the origin, and none with y_0 >= 0 does.
    points = np.column_stack([np.ones(6), *generator.normal(size=(2, 6))])
    points = np.vstack([points, points * [1, -1, -1]])
    start = np.array([0.5, 0.5, 0.5])
    assert separate(Polyhedron(points), [start]).value < 0
    signed = separate(Polyhedron(points, [0]), [start])
    assert signed.value >= 0
    assert signed.multipliers[0] >= 0


def test_multipliers_without_any_chain_separate():
    # Pruning may leave no pair of passing times, so that F is -inf and no chain is known.
    class Pruned(Polyhedron):
        def __call__(self, y):
            return super().__call__(y)._replace(chain=np.ones(4)) if y[0] > 0 else Cut(-np.inf, 0.0, np.zeros(2))

    found = separate(Pruned([[1.0, 0.0], [0.0, 1.0]]), [np.array([1.0, 0.0]), np.array([-1.0, 0.0])])
    assert found.value == -np.inf
    assert found.multipliers.tolist() == [-1.0, 0.0]
