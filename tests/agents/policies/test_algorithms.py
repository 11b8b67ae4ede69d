"""Zips of every algorithm are recognised, loaded and flown as the model itself flies."""

import sys
from importlib import import_module

import numpy as np
import pytest
import sb3_contrib
import stable_baselines3
from stable_baselines3.common.policies import ActorCriticPolicy

from agents import fly, policies
from agents.policies.adapters import load_policy
from agents.policies.algorithms import ALGORITHMS, algorithm, recognise
from agents.training.vec_env import NumberedActions, make_vec_env
from flatgym.envs.levels import Levels

ON_POLICY = {"n_steps": 8, "batch_size": 8}
OFF_POLICY = {"buffer_size": 200, "learning_starts": 8}
ARGUMENTS = {
    "PPO": ON_POLICY,
    "TRPO": ON_POLICY,
    "RecurrentPPO": ON_POLICY,
    "A2C": {},
    "ARS": {"n_delta": 1},
}
NUMBERED = {"DQN", "QRDQN"}
POLICIES = {"RecurrentPPO": "MlpLstmPolicy", "ARS": "LinearPolicy"}


class OwnPolicy(ActorCriticPolicy):
    """A policy class of one's own."""


def small(name, policy=None, **arguments):
    """Return a model of an algorithm that has trained for a moment."""
    policy_kwargs = {} if name == "ARS" else {"net_arch": [8]}
    vec_env = make_vec_env("random-goal", 2)
    model = algorithm(name)(
        policy or POLICIES.get(name, "MlpPolicy"),
        NumberedActions(vec_env, Levels((2, 3))) if name in NUMBERED else vec_env,
        policy_kwargs=policy_kwargs,
        device="cpu",
        seed=0,
        **ARGUMENTS.get(name, OFF_POLICY) | arguments,
    )
    return model.learn(16)


@pytest.fixture(scope="module")
def models():
    return {name: small(name) for name in ALGORITHMS}


@pytest.mark.parametrize("name", ALGORITHMS)
def test_every_algorithm_is_recognised_and_flies_as_its_model(models, tmp_path, name):
    models[name].save(tmp_path / "model.zip")
    found = load_policy(str(tmp_path / "model.zip"), trust=True)
    assert type(found).__name__ == policies.describe(tmp_path / "model.zip")["algorithm"] == name
    flown, expected = fly(found, "random-goal", 3, 5), fly(models[name], "random-goal", 3, 5)
    for one, other in zip(flown.actions, expected.actions, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", ALGORITHMS)
def test_a_model_of_every_algorithm_is_saved_compactly(models, tmp_path, name):
    found = policies.load(policies.save(models[name], tmp_path / "model.zip"), trust=True)
    assert type(found).__name__ == name
    seen = make_vec_env("random-goal", 2, seed=1).reset()
    expected = models[name].predict(seen, deterministic=True)[0]
    np.testing.assert_array_equal(found.predict(seen, deterministic=True)[0], expected)


def test_all_algorithms_of_the_libraries_but_that_for_masked_actions_are_known():
    modules = (stable_baselines3, sb3_contrib)
    every = {name for module in modules for name in module.__all__ if hasattr(getattr(module, name), "learn")}
    assert every - {"MaskablePPO"} == set(ALGORITHMS)


@pytest.mark.parametrize("name", ["PPO", "RecurrentPPO"])
def test_a_policy_class_of_ones_own_does_not_hide_the_algorithm(tmp_path, name):
    kind = OwnPolicy if name == "PPO" else type("Own", (sb3_contrib.RecurrentPPO.policy_aliases["MlpLstmPolicy"],), {})
    small(name, kind).save(tmp_path / "own.zip")
    assert type(policies.load(tmp_path / "own.zip", trust=True)).__name__ == name


def test_the_memory_of_a_recurrent_policy_starts_anew_with_each_episode(models, tmp_path):
    models["RecurrentPPO"].save(tmp_path / "recurrent.zip")
    policy = load_policy(str(tmp_path / "recurrent.zip"), trust=True)
    seen = make_vec_env("random-goal", 2, seed=1).reset()
    first, memory = policy.predict(seen, episode_start=np.ones(2, dtype=bool), deterministic=True)
    second, _ = policy.predict(seen, memory, np.array([True, False]), deterministic=True)
    np.testing.assert_array_equal(second[0], first[0])
    assert not np.array_equal(second[1], first[1])


def test_ddpg_is_a_td3_without_delay_and_noise():
    td3 = {"target_policy_noise": 0.2, "policy_delay": 2, "target_noise_clip": 0.5}
    assert recognise(td3) == "TD3"
    assert recognise(td3 | {"policy_delay": 1}) == "TD3"
    assert recognise(td3 | {"policy_delay": 1, "target_noise_clip": 0.0}) == "DDPG"
    assert recognise({"exploration_fraction": 0.1}) == ""


def test_the_algorithm_can_be_named(models, tmp_path):
    models["DDPG"].save(tmp_path / "model.zip")
    assert type(load_policy(str(tmp_path / "model.zip"), True, algorithm="TD3")).__name__ == "TD3"
    with pytest.raises(ValueError, match="unknown algorithm 'DDPO'; known: PPO, A2C"):
        load_policy(str(tmp_path / "model.zip"), True, algorithm="DDPO")
    with pytest.raises(ValueError, match="an algorithm is that of a zip"):
        load_policy("my_module:policy", algorithm="TD3")


def test_the_module_of_a_policy_class_is_found_beside_the_zip(tmp_path, monkeypatch):
    (tmp_path / "my_flatquad_net.py").write_text(
        "from stable_baselines3.common.policies import ActorCriticPolicy\nclass Mine(ActorCriticPolicy):\n    pass\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    small("PPO", import_module("my_flatquad_net").Mine).save(tmp_path / "mine.zip")
    monkeypatch.undo()
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place != str(tmp_path)])
    monkeypatch.delitem(sys.modules, "my_flatquad_net")
    assert type(policies.load(tmp_path / "mine.zip", trust=True).policy).__name__ == "Mine"
