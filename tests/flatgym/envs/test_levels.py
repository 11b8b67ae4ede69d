"""Numbered actions: all combinations of levels, each once; a policy of numbers flies like one of actions."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import DQN

from agents import evaluate, fly, policies
from agents.training.vec_env import NumberedActions, make_vec_env
from flatgym.envs.levels import Levels


@pytest.mark.parametrize("bins", [(2, 3), (3, 21), (2, 4)])
def test_the_numbers_stand_for_all_combinations_of_levels(bins):
    levels = Levels(bins)
    actions = levels.actions(np.arange(levels.n))
    assert actions.dtype == np.float32
    assert len(np.unique(actions, axis=0)) == levels.n == bins[0] * bins[1]
    for column, count in zip(actions.T, bins, strict=True):
        np.testing.assert_allclose(np.unique(column), np.linspace(-1, 1, count), atol=1e-7)
        assert {-1.0, 1.0} <= set(column)
    np.testing.assert_array_equal(levels.actions(5), actions[5])


def test_levels_are_equal_by_their_bins_also_when_pickled():
    assert pickle.loads(pickle.dumps(Levels((2, 6)))) == Levels((2, 6)) != Levels((3, 4))
    assert gym.spaces.Discrete(12) != Levels((2, 6)) or Levels((2, 6)) != gym.spaces.Discrete(12)


@pytest.mark.parametrize("bins", [(1, 3), (2, 0), (2.5, 3), (2, 5000)])
def test_other_numbers_of_levels_are_refused(bins):
    with pytest.raises(ValueError, match=r"Levels of (thrust|rate) must be a whole number in 2\.\.1001"):
        Levels(bins)


def test_a_vec_env_of_numbers_steps_as_one_of_actions():
    levels, numbers = Levels((2, 5)), np.array([0, 4, 9])
    one, other = NumberedActions(make_vec_env("hoop", 3, seed=0), levels), make_vec_env("hoop", 3, seed=0)
    np.testing.assert_array_equal(one.reset(), other.reset())
    for mine, expected in zip(one.step(numbers), other.step(levels.actions(numbers)), strict=True):
        np.testing.assert_array_equal(mine, expected)


def test_gymnasium_numbers_actions_too_and_the_policy_flies_stored_or_not(tmp_path):
    levels = Levels((2, 3))
    env = gym.wrappers.TransformAction(gym.make("FlatQuad-v0", scenario="horizontal-3"), levels.actions, levels)
    model = DQN("MlpPolicy", env, buffer_size=200, learning_starts=8, device="cpu", seed=0).learn(32)
    flown = fly(model, "horizontal-3").actions[0]
    assert {tuple(action) for action in flown} <= {tuple(action) for action in levels.actions(np.arange(6))}
    stored = policies.load(policies.save(model, tmp_path / "dqn.zip"), trust=True)
    np.testing.assert_array_equal(fly(stored, "horizontal-3").actions[0], flown)
    assert evaluate(stored, "horizontal-3", episodes=1)["success_rate"][0] == 0
