"""The SB3 adapter: terminal observations, truncation, episode records, and learning end to end."""

from dataclasses import replace

import gymnasium as gym
import imageio.v3 as imageio
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import (
    VecCheckNan,
    VecEnv,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
    VecVideoRecorder,
)

from agents import FlatQuadVecEnv, make_vec_env
from flatgym import SCENARIOS, Tolerance
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


# Seeds


@pytest.mark.parametrize("seeds", [(0, 1), (0, 7), (999_990, 1_000_000), (2**32 - 2, 2**32 - 1)])
def test_trainings_with_other_seeds_meet_other_tasks(seeds):
    goals = []
    for seed in seeds:
        vec = make_vec_env("random-goal", 64, seed=seed)
        for _ in range(2):
            goals.append({tuple(row) for row in vec.reset()[:, 0:2].tolist()})
    assert len(set.union(*goals)) == 4 * 64


@pytest.mark.parametrize("seed", [0, 999_999, 1_000_000, 2**32 - 1])
def test_no_training_meets_a_scored_episode(seed):
    vec = make_vec_env("random-goal", 64, seed=seed)
    vec.reset()
    assert vec.envs.fleet.seeds.min() > 10**9
    assert not vec.arrays["k_star"].any()  # known for scored episodes only


def test_seeds_are_those_of_stable_baselines3():
    vec = make_vec_env("random-goal", 3)
    with pytest.raises(ValueError, match=r"seed must be a whole number in 0..4294967295, got -1"):
        vec.seed(-1)
    np.random.seed(0)  # noqa: NPY002 - SB3 draws from it
    first = vec.seed()
    np.random.seed(0)  # noqa: NPY002
    assert vec.seed() == first
    assert vec.seed_exactly(5) == [5, 6, 7]
    np.testing.assert_array_equal(vec.reset(), FlatQuadVectorEnv(3, "random-goal").reset(seed=5)[0])


# Options


def mixed(n):
    """Options of each kind, one for each vehicle."""
    kinds = {}, {"state": [1.0, 2, 0, 0, 0.1]}, {"hoops_passed": 1}, {"state": np.arange(5) / 5, "hoops_passed": 1}
    return [kinds[i % 4] for i in range(n)]


@pytest.mark.parametrize("options", [{"state": [1, 2, 0, 0, 0]}, {"hoops_passed": 1}, {}, None, mixed(6), [{}] * 6])
@pytest.mark.parametrize("seeded", [True, False])
def test_options_start_episodes_as_in_the_scalar_environments(options, seeded):
    vec, singles = (
        make_vec_env("random-hoops", 6, wind=2.0),
        [gym.make("FlatQuad-v0", scenario="random-hoops", wind=2.0) for _ in range(6)],
    )
    each = options if isinstance(options, list) else [options] * 6
    for begun in (False, True):
        if seeded or not begun:
            vec.seed_exactly(40)
        vec.set_options(options)
        observations = vec.reset()
        for i, single in enumerate(singles):
            seed = 40 + i if seeded or not begun else None
            observation, info = single.reset(seed=seed, options=each[i])
            np.testing.assert_allclose(observations[i], observation, atol=1e-7)
            np.testing.assert_equal(vec.reset_infos[i], info)


def test_options_are_used_once():
    vec = make_vec_env("hoop", 2)
    vec.set_options({"state": [1, 0, 0, 0, 0]})
    assert vec.reset_infos == [{}, {}]
    away = vec.reset()
    assert [info["state"].tolist() for info in vec.reset_infos] == [[1, 0, 0, 0, 0]] * 2
    assert (vec.reset() != away).any()
    assert [info["state"][0] for info in vec.reset_infos] == [0, 0]


def test_wrong_options_are_named():
    vec = make_vec_env("hoop", 3)
    with pytest.raises(ValueError, match=r"unknown reset options \['start'\]; known: state, hoops_passed"):
        vec.set_options({"start": 3})
    with pytest.raises(ValueError, match=r"unknown reset options \['reset_mask'\]"):
        vec.set_options([{}, {}, {"reset_mask": [True] * 3}])
    with pytest.raises(ValueError, match="a dict or a list of 3, got 2"):
        vec.set_options([{}, {}])
    vec.set_options([{}, {"state": [0, 0]}, {}])
    with pytest.raises(ValueError, match="must be five finite numbers"):
        vec.reset()


# Infos and pictures


def test_infos_in_flight_are_in_the_arrays():
    vec = make_vec_env("hoop", 3, seed=0)
    vec.set_options([{}, {"state": [2.4, 2.5, 5, 0, 0]}, {}])
    vec.reset()
    _, _, _, infos = vec.step(np.zeros((3, 2), np.float32))
    assert infos == [{}] * 3
    assert VecNormalize(vec).unwrapped.arrays["hoops_passed"].tolist() == [0, 1, 0]
    assert vec.arrays["state"].shape == (3, 5)


@pytest.mark.parametrize("scenario", ["hoop", "random-goal"])
def test_pictures_show_the_first_vehicle(scenario):
    vec, single = (
        make_vec_env(scenario, 3, render_mode="rgb_array"),
        gym.make("FlatQuad-v0", scenario=scenario, render_mode="rgb_array"),
    )
    vec.seed_exactly(7)
    vec.reset()
    single.reset(seed=7)
    actions, ended = np.array([[1.0, 0.1], [0, 1], [0, 0]], np.float32), False
    for k in range(100):
        if k in (0, 3) or ended:
            (picture,) = vec.get_images()
            np.testing.assert_array_equal(picture, single.render())
            np.testing.assert_array_equal(vec.render(), picture)
        if ended:
            break
        vec.step(actions)
        *_, terminated, truncated, _ = single.step(actions[0])
        ended = terminated or truncated
        if ended:
            single.reset()
    assert ended


def test_pictures_need_the_mode():
    with pytest.raises(ValueError, match=r'make_vec_env\(..., render_mode="rgb_array"\)'):
        make_vec_env("hoop", 2).get_images()
    with pytest.raises(ValueError, match="render_mode must be \"rgb_array\" or None, got 'human'"):
        make_vec_env("hoop", 2, render_mode="human")
    with pytest.raises(RuntimeError, match=r"call reset\(\) first"):
        make_vec_env("hoop", 2, render_mode="rgb_array").get_images()


@pytest.mark.parametrize(("name", "hint"), [("n_envs", "'num_envs'"), ("winds", "'wind'"), ("autoreset_mode", "")])
def test_unknown_arguments_are_named_with_the_closest(name, hint):
    with pytest.raises(TypeError, match=rf"unknown argument '{name}' of make_vec_env; known: .*num_envs.*{hint}"):
        make_vec_env("hoop", **{name: 8})


# The wrappers of Stable-Baselines3


def tower():
    """Return the wrappers on top of one another."""
    vec = make_vec_env("horizontal-3", 4, seed=0)
    with pytest.warns(UserWarning, match="already wrapped with a `Monitor`"):  # both report the same episodes
        vec = VecMonitor(vec)
    return VecFrameStack(VecNormalize(VecCheckNan(vec, raise_exception=True)), 2)


def test_ppo_learns_evaluates_saves_and_loads_in_the_tower_of_wrappers(tmp_path):
    envs, evaluated = tower(), tower()
    callback = EvalCallback(evaluated, n_eval_episodes=2, eval_freq=64, log_path=str(tmp_path), verbose=0)
    model = PPO("MlpPolicy", envs, n_steps=64, batch_size=64, seed=0, device="cpu")
    model.learn(1024, callback=callback)
    assert model.ep_info_buffer
    assert np.isfinite(callback.last_mean_reward)
    assert len(callback.evaluations_timesteps) == 4
    model.save(tmp_path / "model.zip")
    envs.venv.save(str(tmp_path / "statistics.pkl"))
    again, statistics = PPO.load(tmp_path / "model.zip", device="cpu"), tower()
    statistics.venv = VecNormalize.load(str(tmp_path / "statistics.pkl"), statistics.venv.venv)
    for one in (envs, statistics):
        one.seed(3)
    observation = envs.reset()
    np.testing.assert_array_equal(statistics.reset(), observation)
    np.testing.assert_array_equal(
        model.predict(observation, deterministic=True)[0], again.predict(observation, deterministic=True)[0]
    )


def test_evaluate_policy_finds_the_records_of_a_monitor():
    bare, monitored = make_vec_env("horizontal-3", 4, seed=0), make_vec_env("horizontal-3", 4, seed=0)
    model = PPO("MlpPolicy", bare, seed=0, device="cpu")
    with pytest.warns(UserWarning, match="already wrapped with a `Monitor`"):
        monitored = VecMonitor(monitored)
    returns, steps = evaluate_policy(model, bare, n_eval_episodes=4, return_episode_rewards=True)  # warns without one
    others, same = evaluate_policy(model, monitored, n_eval_episodes=4, return_episode_rewards=True)
    np.testing.assert_allclose(returns, others, rtol=1e-5)
    assert steps == same
    assert bare.env_is_wrapped(Monitor, indices=[0, 2]) == [True, True]


@pytest.mark.usefixtures("moviepy")
def test_a_film_of_the_first_vehicle_is_recorded(tmp_path):
    scenario = replace(SCENARIOS["hoop"], dt=0.04)
    vec = make_vec_env(scenario, 3, render_mode="rgb_array")
    envs = VecVideoRecorder(VecNormalize(vec), str(tmp_path), lambda step: step == 0, video_length=4)
    assert envs.frames_per_sec == 25
    envs.reset()
    for _ in range(4):
        envs.step(np.zeros((3, 2), np.float32))
    envs.close()
    (file,) = tmp_path.glob("*.gif")
    assert imageio.imread(file).shape == (5, 720, 960, 3)


def test_ppo_learns_saves_and_loads(tmp_path):
    model = PPO("MlpPolicy", make_vec_env("horizontal-3", 8, seed=0), n_steps=16, batch_size=64, seed=0, device="cpu")
    model.learn(256)
    model.save(tmp_path / "model.zip")
    again = PPO.load(tmp_path / "model.zip", device="cpu")
    observation = model.env.reset()
    np.testing.assert_array_equal(
        model.predict(observation, deterministic=True)[0], again.predict(observation, deterministic=True)[0]
    )
