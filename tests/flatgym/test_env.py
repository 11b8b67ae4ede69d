"""FlatQuad-v0: what Gymnasium and SB3 ask of an environment, and clear words for misuse."""

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_sb3

from flatgym import OBSERVATION_NAMES, OUTCOMES, SCENARIOS

INFO_KEYS = {"state", "time", "steps", "hoops_passed", "is_success", "outcome"}


@pytest.mark.parametrize("name", SCENARIOS)
def test_gymnasium_and_sb3_find_no_fault(name):
    env = gym.make("FlatQuad-v0", scenario=name).unwrapped
    check_env(env)
    check_env_sb3(env)


def test_episodes_end_with_one_outcome_and_the_same_info_keys(generator):
    env = gym.make("FlatQuad-v0", scenario="ground-6")
    for _ in range(5):
        _, info = env.reset(seed=1)
        assert info["outcome"] == "flying"
        ended = False
        while not ended:
            assert set(info) == INFO_KEYS
            _, _, terminated, truncated, info = env.step(generator.uniform(-1, 1, 2).astype(np.float32))
            ended = terminated or truncated
        assert info["outcome"] in OUTCOMES[1:]
        assert info["is_success"] == (info["outcome"] == "goal")


def test_reset_starts_anywhere():
    env = gym.make("FlatQuad-v0", scenario="hoop")
    observation, info = env.reset(options={"state": [4.9, 5.0, 0, 0, 0], "hoops_passed": 1})
    assert len(observation) == len(OBSERVATION_NAMES)
    np.testing.assert_array_equal(info["state"], [4.9, 5.0, 0, 0, 0])
    hover = env.unwrapped.scenario.quadrotor.action([9.81, 0.0]).astype(np.float32)
    _, _, terminated, _, info = env.step(hover)
    assert terminated
    assert info["outcome"] == "goal"


def test_finite_actions_beyond_the_box_are_clipped():
    env = gym.make("FlatQuad-v0").unwrapped
    env.reset()
    beyond = env.step(np.array([7.0, -9.0]))[0]
    env.reset()
    np.testing.assert_array_equal(beyond, env.step(np.array([1.0, -1.0]))[0])


@pytest.mark.parametrize(
    ("action", "words"),
    [
        ([0.0, np.nan], r"must be finite, got \[nan\] at indices \[\(1,\)\]"),
        ([np.inf, 0.0], "must be finite"),
        ([0.0], r"must have shape \(2,\), got \(1,\)"),
        ([[0.0, 0.0]], r"must have shape \(2,\), got \(1, 2\)"),
    ],
)
def test_bad_actions_are_refused(action, words):
    env = gym.make("FlatQuad-v0").unwrapped
    env.reset()
    with pytest.raises(ValueError, match=words):
        env.step(np.array(action))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"speed": 3}, r"unknown reset options \['speed'\]; known: state, hoops_passed"),
        ({"state": [0, 0, 0]}, "must be five finite numbers"),
        ({"state": [0, 0, 0, 0, np.nan]}, "must be five finite numbers"),
        ({"hoops_passed": 2}, r"must lie in 0\.\.1, got 2"),
    ],
)
def test_bad_reset_options_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        gym.make("FlatQuad-v0").unwrapped.reset(options=options)


def test_steps_before_reset_and_after_the_end_say_so():
    env = gym.make("FlatQuad-v0").unwrapped
    with pytest.raises(gym.error.ResetNeeded, match="call reset"):
        env.step(np.zeros(2))
    env.reset(options={"state": [5, 5, 0, 0, 0], "hoops_passed": 1})
    env.step(env.scenario.quadrotor.action([9.81, 0.0]))
    with pytest.raises(gym.error.ResetNeeded, match=r"the flight has ended \('goal'\)"):
        env.step(np.zeros(2))


def test_unknown_words_are_refused():
    with pytest.raises(ValueError, match="unknown scenario 'hop'"):
        gym.make("FlatQuad-v0", scenario="hop")
    with pytest.raises(ValueError, match="unknown reward 'dense'; known: shaped, sparse"):
        gym.make("FlatQuad-v0", reward="dense")


def test_import_loads_nothing_heavy():
    code = (
        "import sys, flatgym; print([m for m in ('casadi', 'torch', 'numba', 'pygame', 'pandas') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
