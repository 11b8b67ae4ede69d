"""Sampled scenarios: distributed as documented, functions of seed and episode only."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from scipy.stats import chisquare, kstest

import flatgym
from flatgym import DISTRIBUTIONS, SCENARIOS, Distribution, Quadrotor, Scenario, Tolerance
from flatgym.scenarios.distributions import PER_HOOP, PLACED

COUNT = 20_000


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
        ({"dt": 1.0}, "no step makes a whole turn"),
        ({"time_limit": 0.001}, "time_limit must be at least dt"),
        ({"turn": np.nan}, "turn must be finite"),
    ],
)
def test_invalid_distributions_are_rejected(changes, words):
    with pytest.raises(ValueError, match=words):
        replace(DISTRIBUTIONS["random-goal"], **changes)


def test_a_distribution_is_not_a_scenario():
    with pytest.raises(ValueError, match=r"'random-goal' is a distribution of scenarios; sample one: flatgym\.DISTRIB"):
        flatgym.scenario("random-goal")
    assert not set(DISTRIBUTIONS) & set(SCENARIOS)
    assert replace(DISTRIBUTIONS["random-goal"], tolerance=Tolerance(0.2)).scenario(0).tolerance.position == 0.2
