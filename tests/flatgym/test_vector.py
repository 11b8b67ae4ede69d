"""The batched environment is the scalar one, many times; autoreset as Gymnasium means it."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from flatgym import SCENARIOS
from flatgym.course import Starts
from flatgym.vector import FlatQuadVectorEnv

N = 6


def batched(name, mode=AutoresetMode.NEXT_STEP, **arguments):
    return FlatQuadVectorEnv(N, scenario=name, autoreset_mode=mode, **arguments)


def rough_actions(generator, steps):
    """Actions that hold for a while, so that flights get somewhere; shape (steps, N, 2)."""
    return np.repeat(generator.uniform(-1, 1, (steps // 8 + 1, N, 2)), 8, axis=0)[:steps].astype(np.float32)


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("reward", ["shaped", "sparse"])
def test_batched_equals_scalar_step_for_step(name, reward, generator):
    envs = batched(name, AutoresetMode.SAME_STEP, reward=reward)
    singles = [gym.make("FlatQuad-v0", scenario=name, reward=reward) for _ in range(N)]
    observations, infos = envs.reset(seed=3)
    np.testing.assert_array_equal(observations, np.stack([env.reset(seed=3)[0] for env in singles]))
    for actions in rough_actions(generator, 300):
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        for i, env in enumerate(singles):
            observation, reward_one, *ends, info = env.step(actions[i])
            assert [terminated[i], truncated[i]] == ends
            assert abs(rewards[i] - reward_one) < 1e-12
            last = infos["final_info"] if any(ends) else infos
            for key, value in info.items():
                np.testing.assert_allclose(last[key][i], value, atol=1e-12) if key == "state" else None
                assert key == "state" or last[key][i] == value
            if any(ends):
                np.testing.assert_allclose(infos["final_obs"][i], observation, atol=1e-6)
                observation, _ = env.reset()
            np.testing.assert_allclose(observations[i], observation, atol=1e-6)


def test_both_autoreset_modes_fly_the_same_episodes(generator):
    actions = rough_actions(generator, 400)
    lengths = {}
    for mode in (AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP):
        envs = batched("ground-6", mode)
        envs.reset(seed=0)
        ends = [[] for _ in range(N)]
        cursor = np.zeros(N, dtype=int)
        idle = np.zeros(N, dtype=bool)
        for _ in range(300):
            _, rewards, terminated, truncated, _ = envs.step(actions[cursor, np.arange(N)])
            if mode == AutoresetMode.NEXT_STEP:
                assert np.all(rewards[idle] == 0)
                assert not (terminated | truncated)[idle].any()
                cursor += ~idle
                idle = terminated | truncated
            else:
                cursor += 1
            for i in np.flatnonzero(terminated | truncated):
                ends[i].append(int(cursor[i]))
        lengths[mode] = ends
    for same, following in zip(*lengths.values(), strict=True):
        assert len(following) >= 2
        assert same[: len(following)] == following[: len(same)]


def test_registered_under_one_id():
    envs = gym.make_vec("FlatQuad-v0", num_envs=3, vectorization_mode="vector_entry_point", scenario="diagonal")
    assert isinstance(envs.unwrapped, FlatQuadVectorEnv)
    assert envs.reset(seed=1)[0].shape == (3, 19)
    assert envs.observation_space.contains(envs.reset()[0])


def test_same_seed_same_starts(generator):
    starts = Starts(np.random.default_rng(0).normal(size=(100, 5)))
    first, second = batched("hoop", starts=starts), batched("hoop", starts=starts)
    np.testing.assert_array_equal(first.reset(seed=5)[0], second.reset(seed=5)[0])
    for actions in rough_actions(generator, 50):
        np.testing.assert_array_equal(first.step(actions)[0], second.step(actions)[0])
    assert np.any(first.reset(seed=6)[0] != second.reset(seed=5)[0])


def test_reset_mask_resets_only_the_masked(generator):
    envs = batched("hoop", AutoresetMode.DISABLED)
    envs.reset(seed=0)
    observations, *_ = envs.step(rough_actions(generator, 1)[0])
    mask = np.arange(N) < 2
    fresh, infos = envs.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(fresh[~mask], observations[~mask])
    np.testing.assert_array_equal(infos["steps"], np.where(mask, 0, 1))


def test_max_episode_steps_truncates():
    envs = gym.make_vec("FlatQuad-v0", num_envs=2, vectorization_mode="vector_entry_point", max_episode_steps=3)
    envs.reset()
    flags = [envs.step(np.zeros((2, 2), np.float32))[3].tolist() for _ in range(3)]
    assert flags == [[False, False], [False, False], [True, True]]


def test_misuse_is_named():
    with pytest.raises(ValueError, match="num_envs must be at least 1, got 0"):
        FlatQuadVectorEnv(0)
    with pytest.raises(ValueError, match="does not render"):
        FlatQuadVectorEnv(1, render_mode="human")
    envs = batched("hoop", AutoresetMode.DISABLED)
    with pytest.raises(gym.error.ResetNeeded):
        envs.step(np.zeros((N, 2)))
    envs.reset(options={"state": [5, 5, 0, 0, 0], "hoops_passed": 1})
    actions = np.zeros((N, 2))
    actions[4, 1] = np.nan
    with pytest.raises(ValueError, match=r"at indices \[\(4, 1\)\]"):
        envs.step(actions)
    with pytest.raises(ValueError, match=r"shape \(6, 2\), got \(2,\)"):
        envs.step(np.zeros(2))
    envs.step(np.zeros((N, 2)))
    with pytest.raises(gym.error.ResetNeeded, match=r"flights \[0, 1, 2, 3, 4\] have ended"):
        envs.step(np.zeros((N, 2)))
    with pytest.raises(ValueError, match="reset_mask"):
        envs.reset(options={"reset_mask": [1, 0]})
