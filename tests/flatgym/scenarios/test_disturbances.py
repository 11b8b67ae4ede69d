"""Disturbances: off by default, functions of the seed, exact in the dynamics, within their stated limits."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flatgym import Disturbances
from flatgym.envs.vector import FlatQuadVectorEnv


def test_draws_stay_within_their_strengths():
    seeds = np.arange(5000, dtype=np.uint64)
    factor, wind, delay = Disturbances(2.0, 0.1, 0.2, 3, 0.0).draw(seeds, np.zeros_like(seeds))
    assert factor.min() >= 0.9 / 1.2
    assert factor.max() <= 1.1 / 0.8
    strength = np.hypot(*wind.T)
    assert 1.9 < strength.max() <= 2.0 / 0.8
    assert np.abs(wind.mean(axis=0)).max() < 0.05
    assert np.all(np.bincount(delay) > 1000)
    nothing = Disturbances().draw(seeds, seeds)
    assert np.all(nothing[0] == 1)
    assert not nothing[1].any()
    assert not nothing[2].any()


def test_wind_gain_and_mass_enter_the_equations_of_motion():
    strengths = {"wind": 3.0, "thrust_gain": 0.2, "mass": 0.3}
    env = gym.make("FlatQuad-v0", scenario="diagonal", **strengths).unwrapped
    _, info = env.reset(seed=11)
    factor, wind, _ = Disturbances(**strengths).draw(np.array([11], np.uint64), np.array([0], np.uint64))
    state = info["state"]
    for action in np.random.default_rng(0).uniform(-1, 1, (20, 2)):
        thrust, rate = env.scenario.quadrotor.control(action)

        def motion(_, s, thrust=thrust, rate=rate):
            push = factor[0] * thrust
            return [s[2], s[3], push * np.sin(s[4]) + wind[0, 0], push * np.cos(s[4]) + wind[0, 1] - 9.81, rate]

        state = solve_ivp(motion, (0, 0.02), state, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        info = env.step(action)[4]
        np.testing.assert_allclose(info["state"], state, atol=1e-10)


def test_delayed_actions_give_the_same_trajectory_later():
    late = FlatQuadVectorEnv(8, "diagonal", action_delay=4)
    _, infos = late.reset(seed=0)
    delay = Disturbances(action_delay=4).draw(late.fleet.seeds, late.fleet.episodes)[2]
    assert len(set(delay)) > 2
    actions = np.random.default_rng(0).uniform(-1, 1, (40, 8, 2))
    states = [infos["state"]] + [late.step(action)[4]["state"] for action in actions]
    hover = np.array([(9.81 - 10.5) / 9.5, 0.0])
    for i, steps in enumerate(delay):
        prompt = FlatQuadVectorEnv(1, "diagonal")
        prompt.reset(seed=0)
        flown = [prompt.step(action[None])[4]["state"][0] for action in [hover] * steps + list(actions[:, i])]
        np.testing.assert_allclose(np.array(states)[1:, i], flown[:40], atol=1e-12)


def test_noise_affects_observations_and_not_states():
    noisy, clear = (FlatQuadVectorEnv(500, "hoop", observation="state", sensor_noise=s) for s in (0.01, 0.0))
    seen, truth = noisy.reset(seed=0), clear.reset(seed=0)
    for action in np.random.default_rng(0).uniform(-1, 1, (5, 500, 2)):
        np.testing.assert_array_equal(seen[-1]["state"], truth[-1]["state"])
        errors = seen[0] - truth[0]
        assert np.all(np.abs(errors.std(axis=0) / 0.01 - 1) < 0.15)
        assert np.all(np.abs(errors.mean(axis=0)) < 0.002)
        seen, truth = noisy.step(action), clear.step(action)
    repeated = FlatQuadVectorEnv(500, "hoop", observation="state", sensor_noise=0.01)
    np.testing.assert_array_equal(repeated.reset(seed=0)[0], noisy.reset(seed=0)[0])


def test_each_episode_samples_its_own_disturbances():
    disturbances = Disturbances(wind=1.0)
    seeds = np.zeros(100, dtype=np.uint64)
    winds = disturbances.draw(seeds, np.arange(100, dtype=np.uint64))[1]
    assert len(np.unique(winds, axis=0)) == 100
    assert disturbances.active == {"wind": 1.0}
    assert Disturbances().active == {}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"wind": -1.0}, "wind must be at least 0, got -1.0"),
        ({"mass": 1.0}, "mass must be below 1, a share of the nominal, got 1.0"),
        ({"thrust_gain": 1.5}, "thrust_gain must be below 1"),
        ({"action_delay": 1.5}, "action_delay must be a whole number of steps up to 50, got 1.5"),
        ({"action_delay": 51}, "action_delay must be a whole number"),
        ({"sensor_noise": np.inf}, "sensor_noise must be finite"),
    ],
)
def test_invalid_disturbances_are_rejected(changes, words):
    with pytest.raises(ValueError, match=words):
        replace(Disturbances(), **changes)
    with pytest.raises(ValueError, match=words):
        gym.make("FlatQuad-v0", **changes)
