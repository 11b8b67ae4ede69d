"""Corridors: every weighting of the outer paths leads from start to goal through all hoops, within the heights."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenarios.catalogue import SCENARIOS
from flatgym.scenarios.scenario import Hoop, Scenario
from optimal.paths.corridors import Corridor, corridor, end_weights, paper_corridor
from optimal.paths.curves import PolynomialPath
from optimal.paths.gates import hoop_coordinates
from optimal.paths.regularity import require_regular

PRINTED = [*(name for name in SCENARIOS if name.startswith("horizontal")), "ground-6", "diagonal", "hoop"]
S = np.linspace(0.0, 1.0, 401)


def random_scenario(seed: int) -> Scenario:
    """Return a scenario with one to three hoops at any angle, often with floor, ceiling or a vehicle radius."""
    random = np.random.default_rng(seed)
    goal = random.uniform(-8, 8, 2)
    count = int(random.integers(1, 4))
    hoops = tuple(
        Hoop(
            *(random.uniform(-4, 4, 2) + goal * (j + 1) / (count + 1)), random.uniform(0.4, 1.2), random.uniform(-3, 3)
        )
        for j in range(count)
    )
    heights = [0.0, goal[1], *(hoop.z for hoop in hoops)]
    floor = min(heights) - random.choice([0.0, 0.1, 1.0]) if random.random() < 0.5 else None
    ceiling = max(heights) + random.choice([0.0, 0.1, 1.0]) if random.random() < 0.5 else None
    body = Quadrotor(radius=float(random.choice([0.0, 0.15])))
    return Scenario(f"random {seed}", (0, 0), tuple(goal), hoops, floor=floor, ceiling=ceiling, quadrotor=body)


SOME = [*SCENARIOS.values(), *(random_scenario(seed) for seed in range(40))]
CASES = [pytest.param(scenario, count, id=f"{scenario.name} {count}") for scenario in SOME for count in (2, 4)]


def positions(found: Corridor, s: Array, order: int = 0) -> Array:
    return np.stack([path(s, order) for path in found.paths], axis=-2)


@pytest.mark.parametrize(("scenario", "count"), CASES)
def test_outer_paths_keep_all_constraints_for_any_weights(scenario: Scenario, count: int) -> None:
    found = corridor(scenario, count)
    outer = positions(found, S)
    low, high = scenario.floor, scenario.ceiling
    assert low is None or outer[..., 1].min() >= low - 1e-12
    assert high is None or outer[..., 1].max() <= high + 1e-12
    for order in (1, 2):
        np.testing.assert_allclose(positions(found, np.array([0.0, 1.0]), order), 0, atol=1e-8)
    np.testing.assert_allclose(found.ends[0] @ outer[0], scenario.start, atol=1e-9)
    np.testing.assert_allclose(found.ends[1] @ outer[-1], scenario.goal, atol=1e-9)
    for hoop, s in zip(scenario.hoops, hoop_coordinates(scenario), strict=True):
        offset = positions(found, s) - hoop.centre
        np.testing.assert_allclose(offset @ hoop.direction, 0, atol=1e-9)
        assert np.abs(offset @ hoop.across).max() <= hoop.diameter / 2 - scenario.quadrotor.radius + 1e-9
        assert (positions(found, s, 1) @ hoop.direction).min() > 0


@pytest.mark.parametrize(("scenario", "count"), CASES)
def test_the_central_path_is_regular_and_leads_from_start_to_goal(scenario: Scenario, count: int) -> None:
    central = corridor(scenario, count).central
    require_regular(central)
    np.testing.assert_allclose(central([0.0, 1.0]), [scenario.start, scenario.goal], atol=1e-9)
    step = 1e-5
    difference = (central(S[1:-1] + step) - central(S[1:-1] - step)) / (2 * step)
    np.testing.assert_allclose(central(S[1:-1], 1), difference, atol=1e-3)


@pytest.mark.parametrize("count", [2, 4])
def test_corridors_are_wide_between_hoops(count: int) -> None:
    for scenario in SCENARIOS.values():
        middles = np.convolve(np.concatenate([[0.0], hoop_coordinates(scenario), [1.0]]), [0.5, 0.5], "valid")
        assert np.ptp(positions(corridor(scenario, count), middles), axis=1).max(axis=1).min() > 1.0


def test_corridors_of_mirrored_scenarios_are_mirrored() -> None:
    task = SCENARIOS["slalom"]
    hoops = tuple(Hoop(-h.x, h.z, h.diameter, math.pi - h.angle) for h in task.hoops)
    mirrored = dataclasses.replace(task, goal=(-task.goal[0], task.goal[1]), hoops=hoops)
    here, there = (positions(corridor(t, 4), S) for t in (task, mirrored))
    np.testing.assert_allclose(there[:, [1, 0, 3, 2]] * [-1, 1], here, atol=1e-9)


def test_the_same_hoop_can_be_passed_twice_in_opposite_directions() -> None:
    task = Scenario("back", (0, 0), (0, 1), hoops=(Hoop(3, 0, 1.0), Hoop(3, 0, 1.0, math.pi)))
    require_regular(corridor(task).central)


def test_an_impossible_corridor_is_refused_with_the_reason() -> None:
    task = Scenario("dive", (0, 0), (4, 0), hoops=(Hoop(2, 0, 1.0, -math.pi / 2),), floor=0.0)
    with pytest.raises(ValueError, match=r"no corridor for 'dive': hoops\[0\].*floor 0"):
        corridor(dataclasses.replace(task, quadrotor=Quadrotor(radius=0.1)))
    with pytest.raises(ValueError, match=r"must be 2 .* or 4 .*, got 3"):
        corridor(SCENARIOS["hoop"], 3)


@pytest.mark.parametrize("name", PRINTED)
def test_printed_corridors_lead_from_start_to_goal_and_rest(name: str) -> None:
    task, found = SCENARIOS[name], paper_corridor(SCENARIOS[name])
    np.testing.assert_allclose(found.central([0.0, 1.0]), [task.start, task.goal], atol=1e-12)
    for path in found.paths:
        np.testing.assert_allclose(path([0.0, 1.0], 1), 0, atol=1e-9)
        np.testing.assert_allclose(path([0.0, 1.0], 2)[:, 0], 0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "heights", "ends"),
    [("horizontal-6", (-1, 1), (0.5, 0.5)), ("ground-6", (0, 1), (1, 1)), ("diagonal", (0, 5), (1, 0))],
)
def test_level_corridors_are_the_printed_ones(
    name: str, heights: tuple[float, float], ends: tuple[float, float]
) -> None:
    found = paper_corridor(SCENARIOS[name])
    np.testing.assert_allclose(found.ends[:, 0], ends, atol=1e-12)
    np.testing.assert_allclose(positions(found, S)[..., 1], np.broadcast_to(heights, (len(S), 2)), atol=1e-12)


def test_the_printed_hoop_corridor_narrows_to_the_hoop() -> None:
    upper, lower = paper_corridor(SCENARIOS["hoop"]).paths
    gap = (upper(S) - lower(S))[:, 1]
    np.testing.assert_allclose([upper(0.5), lower(0.5)], [[2.5, 2.75], [2.5, 2.25]], atol=1e-12)
    assert gap.argmin() == 200
    assert gap.min() == pytest.approx(0.5)


def test_printed_paths_move_with_the_start_and_are_cut_by_floor_and_ceiling() -> None:
    found = paper_corridor(Scenario("left", (1.0, 2.0), (-3.0, -1.0)))
    np.testing.assert_allclose([found.paths[0](0.0), found.paths[1](1.0)], [[1, -2], [-3, 3]], atol=1e-12)
    np.testing.assert_allclose(found.ends[:, 0], (0.2, 0.8))
    low, high = paper_corridor(dataclasses.replace(SCENARIOS["horizontal-6"], floor=-0.25, ceiling=0.5)).paths
    np.testing.assert_allclose([low(0.5)[1], high(0.5)[1]], [-0.25, 0.5])


@pytest.mark.parametrize("name", ["climb", "drop"])
def test_the_paper_has_no_vertical_flights(name: str) -> None:
    with pytest.raises(ValueError, match=f"'{name}'.*vertical"):
        paper_corridor(SCENARIOS[name])


@pytest.mark.parametrize(
    "task",
    [
        SCENARIOS["high-hoop"],
        SCENARIOS["loop"],
        dataclasses.replace(SCENARIOS["hoop"], floor=0.0),
        dataclasses.replace(SCENARIOS["hoop"], quadrotor=Quadrotor(radius=0.1)),
        dataclasses.replace(SCENARIOS["hoop"], hoops=(Hoop(2.5, 2.5, 0.4),)),
    ],
)
def test_the_paper_has_no_other_hoops(task: Scenario) -> None:
    with pytest.raises(ValueError, match="only hoop flight"):
        paper_corridor(task)


def test_bad_corridors_are_refused() -> None:
    low, high = (PolynomialPath(((0.0, 1.0), (height,))) for height in (-1.0, 1.0))
    with pytest.raises(ValueError, match="at least two outer paths, got 1"):
        Corridor((low,), np.ones((2, 1)))
    with pytest.raises(ValueError, match=r"shape \(2, 2\)"):
        Corridor((low, high), np.ones(2))
    for ends in ([[0.4, 0.4], [0.5, 0.5]], [[1.5, -0.5], [0.5, 0.5]], [[math.nan, 1.0], [0.5, 0.5]]):
        with pytest.raises(ValueError, match="1 in sum"):
            Corridor((low, high), np.array(ends))
    with pytest.raises(ValueError, match=r"\(0.0, 2.0\) does not lie between the outer paths at s = 0"):
        end_weights((low, high), (0, 2), (1, 0))
