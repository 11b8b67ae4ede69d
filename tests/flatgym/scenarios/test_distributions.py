"""Sampled scenarios: distributed as documented, functions of seed and episode only."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.stats import chisquare, kstest

import flatgym
from flatgym import DISTRIBUTIONS, SCENARIOS, Distribution, Quadrotor, Scenario, Tolerance
from flatgym.envs.compiled_fleet import CompiledFleet
from flatgym.envs.config import EnvConfig
from flatgym.scenarios.counter_rng import DISTURBANCE, SCENE
from flatgym.scenarios.distributions import HOOPS_MOST
from flatgym.scenarios.layouts import PER_HOOP, PLACED, uniforms_needed

COUNT = 20_000
TRACK = DISTRIBUTIONS["random-track"]
CROWDED = replace(TRACK, name="crowded", least_distance=2.0, leg=(2.0, 2.0), bend=np.pi)
"""Tracks that often turn back to an earlier hoop."""


def drawn(name, count=COUNT):
    seeds = np.arange(count, dtype=np.uint64)
    return DISTRIBUTIONS[name].draw(seeds, np.zeros_like(seeds))


def test_goals_are_uniform_in_the_square_outside_the_minimum_distance():
    rows = drawn("random-goal")
    assert np.all(np.abs(rows[:, 0:2]) <= 10.0)
    assert np.hypot(rows[:, 0], rows[:, 1]).min() >= 0.5
    for column in rows[:, 0:2].T:
        assert kstest(column, "uniform", args=(-10, 20)).pvalue > 1e-3
    far = drawn("random-hoops")
    assert np.hypot(far[:, 0], far[:, 1]).min() >= 3.0
    # Uniform but for the disc around the start: every cell of a grid outside it is equally likely.
    cells, _, _ = np.histogram2d(far[:, 0], far[:, 1], bins=10, range=[[-10, 10]] * 2)
    outside = np.ones((10, 10), dtype=bool)
    outside[3:7, 3:7] = False
    assert chisquare(cells[outside]).pvalue > 1e-3


def test_hoops_are_in_order_along_the_line_to_the_goal():
    distribution, rows = DISTRIBUTIONS["random-hoops"], drawn("random-hoops", 3000)
    count = rows[:, 2].astype(int)
    assert chisquare(np.bincount(count)[1:]).pvalue > 1e-3
    for row, number in zip(rows[:500], count[:500], strict=True):
        goal, hoops = row[0:2], row[PLACED : PLACED + PER_HOOP * number].reshape(number, PER_HOOP)
        length = np.hypot(*goal)
        way = goal / length
        np.testing.assert_allclose(hoops[:, 0:2] @ way, length * np.arange(1, number + 1) / (number + 1))
        aside = hoops[:, 0:2] @ [-way[1], way[0]]
        assert np.all(np.abs(aside) <= distribution.aside * length / (number + 1))
        turn = np.angle(np.exp(1j * (hoops[:, 2] - np.arctan2(way[1], way[0]))))
        assert np.all(np.abs(turn) <= distribution.turn)
        assert np.all((hoops[:, 3] >= 0.5) & (hoops[:, 3] <= 1.0))


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_an_environment_uses_the_scenarios_of_its_seed_in_order(name):
    env = gym.make("FlatQuad-v0", scenario=name)
    for episode in range(3):
        observation, _ = env.reset(seed=5 if episode == 0 else None)
        expected = DISTRIBUTIONS[name].scenario(5, episode)
        assert env.unwrapped.scenario == expected
        plain = gym.make("FlatQuad-v0", scenario=expected)
        np.testing.assert_allclose(observation, plain.reset(seed=0)[0], atol=1e-7)
        for action in np.random.default_rng(episode).uniform(-1, 1, (30, 2)).astype(np.float32):
            *one, info = env.step(action)
            *other, same = plain.step(action)
            for a, b in zip(one, other, strict=True):
                np.testing.assert_allclose(a, b, atol=1e-7)
            assert info["outcome"] == same["outcome"]
            if one[2]:
                break
    assert len({DISTRIBUTIONS[name].scenario(5, i).goal for i in range(50)}) == 50
    assert Scenario.from_json(expected.to_json()) == expected


def places(distribution, count):
    """Return the start, hoops and goal of tracks, and the directions of their hoops, one pair a track."""
    seeds = np.arange(count, dtype=np.uint64)
    for row in distribution.draw(seeds, np.zeros_like(seeds)):
        hoops = row[PLACED:].reshape(-1, PER_HOOP)[: int(row[2])]
        yield np.array([(0.0, 0.0), *hoops[:, 0:2], row[0:2]]), np.exp(1j * hoops[:, 2])


@pytest.mark.parametrize("distribution", [TRACK, CROWDED], ids=lambda distribution: distribution.name)
def test_no_two_places_of_a_track_are_near_each_other(distribution):
    least, farthest = distribution.least_distance, distribution.farthest
    assert least >= distribution.diameter[1]  # so no two gaps touch
    for points, _ in places(distribution, 5000):
        assert pdist(points).min() >= least - 1e-9
        assert np.linalg.norm(points, axis=1).max() <= farthest


def test_tracks_have_every_number_of_hoops_and_every_direction():
    rows = drawn("random-track")
    assert chisquare(np.bincount(rows[:, 2].astype(int))[4:]).pvalue > 1e-3
    hoops = rows[:, PLACED:].reshape(COUNT, -1, PER_HOOP)[:, 0]
    assert kstest(hoops[:, 2] % (2 * np.pi), "uniform", args=(0, 2 * np.pi)).pvalue > 1e-3
    assert kstest(hoops[:, 3], "uniform", args=(0.5, 0.5)).pvalue > 1e-3


def test_legs_bend_and_hoops_face_them_as_documented():
    outwards, legs_seen = 0, 0
    for points, facing in places(TRACK, 5000):
        legs = np.diff(points, axis=0) @ [1, 1j]
        turned = np.abs(np.angle(legs[1:] / legs[:-1]))
        usual = (np.abs(legs) >= 2.0 - 1e-9) & (np.abs(legs) <= 4.0 + 1e-9)
        usual[1:] &= turned <= TRACK.bend + 1e-9
        outwards, legs_seen = outwards + np.sum(~usual), legs_seen + len(legs)
        way = points[:, 0] + 1j * points[:, 1]
        # The other legs lead straight away from the start, to a place beyond all earlier ones.
        for i in np.flatnonzero(~usual):
            assert abs(way[i + 1]) == pytest.approx(np.abs(way[: i + 1]).max() + TRACK.least_distance)
            assert np.angle(way[i + 1] / way[i]) == pytest.approx(0)
        bisector = legs[1:] / np.abs(legs[1:]) + legs[:-1] / np.abs(legs[:-1])
        assert np.abs(np.angle(facing / bisector)).max() <= TRACK.turn + 1e-9
        both = usual[1:] & usual[:-1]
        assert np.all((facing * legs[1:].conj()).real[both] > 0)
        assert np.all((facing * legs[:-1].conj()).real[both] > 0)
    assert 0 < outwards < 0.005 * legs_seen


@pytest.mark.parametrize("distribution", [*DISTRIBUTIONS.values(), CROWDED], ids=lambda distribution: distribution.name)
def test_compiled_scenes_are_the_scenarios(distribution):
    n, most = 200, distribution.hoops[1]
    fleet = CompiledFleet(EnvConfig(distribution), n)
    fleet.reseed(np.ones(n, dtype=bool), np.arange(n))
    fleet.reset(np.ones(n, dtype=bool))
    for i in range(n):
        scenario = distribution.scenario(i)
        expected = [(*hoop.centre, *hoop.direction, hoop.diameter) for hoop in scenario.hoops]
        np.testing.assert_allclose(fleet.hoops[i, : len(expected)], np.reshape(expected, (-1, 5)), rtol=0, atol=1e-12)
        assert len(scenario.hoops) <= most


def test_the_numbers_of_a_scene_are_its_own():
    assert SCENE + uniforms_needed(HOOPS_MOST) <= DISTURBANCE


def test_a_goal_too_near_after_all_tries_is_moved_outwards():
    tight = Distribution("tight", half_width=1.0, least_distance=1.0)
    for seed in range(300):
        x, z = tight.scenario(seed).goal
        assert np.hypot(x, z) >= 1.0 - 1e-12


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"half_width": -1.0}, "half_width must be positive"),
        ({"least_distance": 0.05}, r"least_distance must lie above tolerance\.position = 0\.1 m"),
        ({"least_distance": 11.0}, r"not above half_width = 10\.0 m, got 11\.0"),
        ({"hoops": (2, 1)}, r"hoops must be two whole numbers 0 <= a <= b <= 8"),
        ({"hoops": (0, 9)}, r"hoops must be two whole numbers 0 <= a <= b <= 8"),
        ({"diameter": (0.1, 0.5), "quadrotor": Quadrotor(radius=0.1)}, "diameter must be two widths"),
        ({"diameter": (1e-8, 0.5)}, "diameter must be two widths 1e-07 m <= a <= b"),
        ({"dt": 1.0}, "no step makes a whole turn"),
        ({"time_limit": 0.001}, "time_limit must be at least dt"),
        ({"turn": np.nan}, "turn must be finite"),
    ],
)
def test_invalid_distributions_are_rejected(changes, words):
    with pytest.raises(ValueError, match=words):
        replace(DISTRIBUTIONS["random-goal"], **changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"leg": (3.0, 2.0)}, r"leg must be two lengths a <= b, got \(3\.0, 2\.0\)"),
        ({"leg": (0.0, 2.0)}, "leg must be positive, got 0"),
        ({"leg": 2.0}, "leg must be"),
        ({"leg": (1.0, 2.0)}, r"least_distance must lie above .* and not above leg\[0\] = 1\.0 m, got 1\.5"),
        ({"least_distance": 0.9}, r"at least diameter\[1\] = 1\.0 m on tracks, so that no two gaps touch, got 0\.9"),
        ({"bend": 3.2}, "bend must lie within half a turn, pi, got 3.2"),
        ({"bend": np.nan}, "bend must be finite"),
        ({"leg": (2.0, 5e5)}, r"leg\[1\] \* \(hoops\[1\] \+ 1\), the farthest hoop, must lie within 1e\+06 of zero"),
    ],
)
def test_invalid_tracks_are_rejected(changes, words):
    with pytest.raises(ValueError, match=words):
        replace(TRACK, **changes)


def test_a_distribution_is_not_a_scenario():
    with pytest.raises(ValueError, match="'random-goal' is a distribution of scenarios; sample one by its seed"):
        flatgym.scenario("random-goal")
    assert not set(DISTRIBUTIONS) & set(SCENARIOS)
    assert replace(DISTRIBUTIONS["random-goal"], tolerance=Tolerance(0.2)).scenario(0).tolerance.position == 0.2
