"""The printed outer paths: exact derivatives, rest at the ends, corridors where they should be."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from flatgym.catalogue import SCENARIOS
from flatgym.quadrotor import Quadrotor
from flatgym.scenario import Hoop, Scenario
from optimal.paths import PolynomialPath, end_weights, hoop_paths, level_paths, paper_outer_paths

PRINTED = ["horizontal-3", "horizontal-6", "horizontal-9", "horizontal-12", "horizontal-15", "ground-6", "diagonal"]
PRINTED += ["hoop"]


@pytest.mark.parametrize("name", PRINTED)
@pytest.mark.parametrize("order", [1, 2, 3])
def test_derivatives_agree_with_finite_differences(name: str, order: int) -> None:
    s, h = np.linspace(0.01, 0.99, 50), 1e-5
    for path in paper_outer_paths(SCENARIOS[name]).paths:
        difference = (path(s + h, order - 1) - path(s - h, order - 1)) / (2 * h)
        np.testing.assert_allclose(path(s, order), difference, atol=1e-6 * np.abs(path(s, order)).max() + 1e-9)


@pytest.mark.parametrize("name", PRINTED)
def test_every_path_is_at_rest_and_without_sideways_acceleration_at_its_ends(name: str) -> None:
    for path in paper_outer_paths(SCENARIOS[name]).paths:
        np.testing.assert_allclose(path([0.0, 1.0], 1), 0, atol=1e-9)
        np.testing.assert_allclose(path([0.0, 1.0], 2)[:, 0], 0, atol=1e-9)


@pytest.mark.parametrize("name", PRINTED)
def test_end_weights_lead_from_start_to_goal(name: str) -> None:
    task = SCENARIOS[name]
    (first, second), weights = paper_outer_paths(task)
    for s, p, point in zip((0.0, 1.0), weights, (task.start, task.goal), strict=True):
        np.testing.assert_allclose(p * first(s) + (1 - p) * second(s), point, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "heights", "ends"),
    [("horizontal-6", (-1, 1), (0.5, 0.5)), ("ground-6", (0, 1), (1, 1)), ("diagonal", (0, 5), (1, 0))],
)
def test_level_corridors_are_the_printed_ones(
    name: str, heights: tuple[float, float], ends: tuple[float, float]
) -> None:
    found = paper_outer_paths(SCENARIOS[name])
    assert found.ends == ends
    for path, height in zip(found.paths, heights, strict=True):
        np.testing.assert_array_equal(path(np.linspace(0, 1, 5))[:, 1], height)


def test_the_hoop_corridor_narrows_to_the_hoop() -> None:
    upper, lower = hoop_paths()
    s = np.linspace(0, 1, 201)
    gap = (upper(s) - lower(s))[:, 1]
    np.testing.assert_allclose(upper(0.5), [2.5, 2.75], atol=1e-12)
    np.testing.assert_allclose(lower(0.5), [2.5, 2.25], atol=1e-12)
    assert gap.argmin() == 100
    assert gap.min() == pytest.approx(0.5)


def test_a_batch_of_any_shape_answers_as_its_elements() -> None:
    path = hoop_paths()[0]
    s = np.linspace(0, 1, 6).reshape(2, 3)
    assert path(0.3).shape == (2,)
    assert path(s, 2).shape == (2, 3, 2)
    np.testing.assert_array_equal(path(s, 3)[1, 2], path(s[1, 2], 3))


def test_paths_move_with_the_start_and_turn_with_the_goal() -> None:
    left = Scenario("left", (1.0, 2.0), (-3.0, -1.0))
    (low, high), ends = paper_outer_paths(left)
    np.testing.assert_allclose([low(0.0), high(1.0)], [[1.0, -2.0], [-3.0, 3.0]], atol=1e-12)
    np.testing.assert_allclose(ends, (0.2, 0.8))


def test_floor_and_ceiling_cut_the_corridor() -> None:
    low, high = paper_outer_paths(dataclasses.replace(SCENARIOS["horizontal-6"], floor=-0.25, ceiling=0.5)).paths
    assert low(0.5)[1] == -0.25
    assert high(0.5)[1] == 0.5


@pytest.mark.parametrize("name", ["climb", "drop"])
def test_vertical_flights_are_refused_with_a_reason(name: str) -> None:
    with pytest.raises(ValueError, match=f"'{name}'.*vertical"):
        paper_outer_paths(SCENARIOS[name])


@pytest.mark.parametrize(
    "task",
    [
        SCENARIOS["high-hoop"],
        SCENARIOS["slalom"],
        SCENARIOS["loop"],
        dataclasses.replace(SCENARIOS["hoop"], floor=0.0),
        dataclasses.replace(SCENARIOS["hoop"], quadrotor=Quadrotor(radius=0.1)),
        dataclasses.replace(SCENARIOS["hoop"], hoops=(Hoop(2.5, 2.5, 0.4),)),
    ],
)
def test_hoops_other_than_the_papers_are_refused_with_a_reason(task: Scenario) -> None:
    with pytest.raises(ValueError, match="only hoop flight"):
        paper_outer_paths(task)


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="must be at least 0, got -1"):
        PolynomialPath((0.0, 1.0), (0.0,))(0.5, -1)
    with pytest.raises(ValueError, match="x_distance is 0"):
        level_paths((0, 0), 0.0, -1.0, 1.0)
    with pytest.raises(ValueError, match="lower path"):
        level_paths((0, 0), 1.0, 1.0, 1.0)
    with pytest.raises(ValueError, match="does not lie between"):
        end_weights(level_paths((0, 0), 1.0, -1.0, 1.0), (0, 2), (1, 0))
