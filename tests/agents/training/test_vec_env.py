"""The SB3 adapter: terminal observations, truncation, episode records, and learning end to end."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

from agents import FlatQuadVecEnv, make_vec_env
from flatgym import Tolerance
from flatgym.envs.config import Starts
from flatgym.envs.vector import FlatQuadVectorEnv


def test_it_matches_the_scalar_environment(generator):
    vec, single = (
        make_vec_env("ground-6", 3, reward="sparse", seed=0),
        gym.make("FlatQuad-v0", scenario="ground-6", reward="sparse"),
    )
    assert isinstance(vec, VecEnv)
    observations, (first, _) = vec.reset(), single.reset()
    np.testing.assert_array_equal(observations, np.stack([first] * 3))
    ends = 0
    for actions in np.repeat(generator.uniform(-1, 1, (60, 2)), 8, axis=0).astype(np.float32):
        observations, rewards, dones, infos = vec.step(np.stack([actions] * 3))
        observation, reward, terminated, truncated, info = single.step(actions)
        np.testing.assert_allclose(rewards, reward, rtol=1e-6)
        np.testing.assert_array_equal(dones, terminated or truncated)
        assert infos[0].get("TimeLimit.truncated", False) == truncated
        if terminated or truncated:
            ends += 1
            np.testing.assert_allclose(infos[1]["terminal_observation"], observation, atol=1e-6)
            assert infos[1]["outcome"] == info["outcome"]
            assert infos[1]["episode"]["l"] == info["steps"]
            failed = info["outcome"] != "goal"
            assert infos[1]["episode"]["r"] == pytest.approx(-5.0 if failed else -info["time"])
            observation, _ = single.reset()
        else:
            assert infos == [{}] * 3
        np.testing.assert_allclose(observations[2], observation, atol=1e-6)
    assert ends >= 3


def test_truncation_differs_from_termination():
    vec = make_vec_env("hoop", 2)
    vec.reset()
    hover = np.tile(vec.envs.scenario.quadrotor.action([9.81, 0.0]), (2, 1)).astype(np.float32)
    for _ in range(vec.envs.scenario.max_steps):
        _, _, dones, infos = vec.step(hover)
    assert dones.all()
    assert infos[0]["TimeLimit.truncated"]
    assert infos[0]["outcome"] == "time-limit"


def test_seed_is_used_at_the_next_reset():
    starts = Starts(np.random.default_rng(0).normal(size=(100, 5)))
    vec = make_vec_env("hoop", 4, starts=starts, seed=3)
    first = vec.reset()
    vec.seed(3)
    np.testing.assert_array_equal(vec.reset(), first)
    assert np.any(vec.reset() != first)


def test_shared_attributes_are_set_for_all_or_not_at_all():
    vec = make_vec_env("hoop", 3)
    vec.env_method("set_tolerance", Tolerance(position=0.5))
    assert [scenario.tolerance.position for scenario in vec.get_attr("scenario")] == [0.5] * 3
    assert vec.env_is_wrapped(gym.Wrapper) == [False] * 3
    with pytest.raises(ValueError, match="indices=0 would split them"):
        vec.set_attr("render_mode", "none", indices=0)
    vec.set_attr("render_mode", "none")
    assert vec.envs.render_mode == "none"


def test_other_autoreset_modes_are_refused():
    with pytest.raises(ValueError, match="needs SAME_STEP"):
        FlatQuadVecEnv(FlatQuadVectorEnv(2))


def test_ppo_learns_saves_and_loads(tmp_path):
    model = PPO("MlpPolicy", make_vec_env("horizontal-3", 8, seed=0), n_steps=16, batch_size=64, seed=0, device="cpu")
    model.learn(256)
    model.save(tmp_path / "model.zip")
    again = PPO.load(tmp_path / "model.zip", device="cpu")
    observation = model.env.reset()
    np.testing.assert_array_equal(
        model.predict(observation, deterministic=True)[0], again.predict(observation, deterministic=True)[0]
    )
