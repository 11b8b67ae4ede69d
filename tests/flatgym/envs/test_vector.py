"""The batched environment equals the scalar one; autoreset as Gymnasium defines it."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from flatgym import DISTRIBUTIONS, SCENARIOS
from flatgym.envs.config import Starts
from flatgym.envs.env import FlatQuadEnv
from flatgym.envs.vector import FlatQuadVectorEnv
from flatgym.scenarios.reference import EVALUATION_SEED, drawn_k_star, reference
from flatgym.scenarios.scenario import Tolerance

N = 6
FLOWN = ("horizontal-6", "ground-6", "hoop", "loop", "zigzag-12", *DISTRIBUTIONS)
"""A scenario of each kind: without hoops, with a floor, with one hoop, with the same hoop twice, with most hoops."""


def batched(name, mode=AutoresetMode.NEXT_STEP, **arguments):
    return FlatQuadVectorEnv(N, scenario=name, autoreset_mode=mode, **arguments)


def rough_actions(generator, steps):
    """Actions that hold for a while, so that flights get somewhere; shape (steps, N, 2)."""
    return np.repeat(generator.uniform(-1, 1, (steps // 8 + 1, N, 2)), 8, axis=0)[:steps].astype(np.float32)


def places(name):
    """Starts near what a scenario names, half of them; so hoops, floor and goal are met within few steps."""
    if name in DISTRIBUTIONS:
        return None
    scenario, generator = SCENARIOS[name], np.random.default_rng(1)
    points = np.array([scenario.start, scenario.goal, *((hoop.x, hoop.z) for hoop in scenario.hoops)])
    state = np.concatenate([generator.normal(0, 0.4, (300, 2)), generator.normal(0, 2.0, (300, 3))], axis=1)
    state[:, 0:2] += points[generator.integers(len(points), size=300)]
    if scenario.floor is not None:
        state[:, 1] = np.maximum(state[:, 1], scenario.floor)
    return Starts(state, generator.integers(0, len(scenario.hoops) + 1, 300), share=0.5)


@pytest.mark.parametrize("name", FLOWN)
def test_batched_equals_scalar_over_forty_thousand_steps(name, generator):
    count, steps = 20, 2000
    arguments = {"scenario": name, "starts": places(name), "reward": "sparse" if name == "hoop" else "shaped"}
    envs = FlatQuadVectorEnv(count, autoreset_mode="SameStep", **arguments)
    singles = [FlatQuadEnv(**arguments) for _ in range(count)]
    observations, infos = envs.reset(seed=3)
    np.testing.assert_array_equal(observations, [env.reset(seed=3 + i)[0] for i, env in enumerate(singles)])
    ends = 0
    for step in range(steps):
        if step % 8 == 0:
            actions = generator.uniform(-1.2, 1.2, (count, 2)).astype(np.float32)
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        flown = [env.step(action) for env, action in zip(singles, actions, strict=True)]
        ended = terminated | truncated
        expected = np.array([one[0] for one in flown])
        np.testing.assert_array_equal(rewards, [one[1] for one in flown])
        np.testing.assert_array_equal(terminated, [one[2] for one in flown])
        np.testing.assert_array_equal(truncated, [one[3] for one in flown])
        np.testing.assert_array_equal(infos["state"][~ended], [one[4]["state"] for one in flown if not one[2] | one[3]])
        for i in np.flatnonzero(ended):
            ends += 1
            final = {key: values[i] for key, values in infos["final_info"].items() if key[0] != "_"}
            np.testing.assert_array_equal(final.pop("state"), flown[i][4].pop("state"))
            np.testing.assert_equal(final, flown[i][4])
            np.testing.assert_array_equal(infos["final_obs"][i], flown[i][0])
            expected[i], info = singles[i].reset()
            np.testing.assert_array_equal(infos["state"][i], info["state"])
        np.testing.assert_array_equal(observations, expected)
    assert ends > 120


def test_both_autoreset_modes_give_the_same_episodes(generator):
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


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_k_star_is_that_of_the_episode_or_unknown(mode):
    goal, known = DISTRIBUTIONS["random-goal"], drawn_k_star("random-goal", EVALUATION_SEED + np.arange(2)).k_star
    envs = FlatQuadVectorEnv(2, scenario=goal, autoreset_mode=mode, max_episode_steps=1)
    reported = [envs.reset(seed=EVALUATION_SEED)[1], *(envs.step(np.zeros((2, 2)))[4] for _ in range(1))]
    assert np.array_equal(reported[0]["k_star"], known)
    later = reported[1]["final_info"] if mode == AutoresetMode.SAME_STEP else reported[1]
    assert np.array_equal(later["k_star"], known)
    again = reported[1] if mode == AutoresetMode.SAME_STEP else None
    if mode == AutoresetMode.NEXT_STEP:
        again = envs.step(np.zeros((2, 2)))[4]
    if mode == AutoresetMode.DISABLED:
        again = envs.reset()[1]
    assert not again["k_star"].any()


def test_k_star_of_a_named_scenario_lasts_until_the_task_changes():
    envs = FlatQuadVectorEnv(3, scenario="hoop", autoreset_mode="SameStep", max_episode_steps=1)
    k_star = reference("hoop").k_star
    for reported in (envs.reset(seed=0)[1], envs.step(np.zeros((3, 2)))[4], envs.reset()[1]):
        assert (reported["k_star"] == k_star).all()
    elsewhere = envs.reset(options={"state": [1, 0, 0, 0, 0], "reset_mask": np.arange(3) == 1})[1]["k_star"]
    assert elsewhere.tolist() == [k_star, 0, k_star]
    envs.set_tolerance(Tolerance(position=0.2))
    assert not envs.step(np.zeros((3, 2)))[4]["k_star"].any()
    assert not envs.reset()[1]["k_star"].any()
    pool = Starts(np.zeros((1, 5)), np.zeros(1, dtype=np.int64))
    assert not FlatQuadVectorEnv(1, scenario="hoop", starts=pool).reset(seed=0)[1]["k_star"].any()


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
    with pytest.raises(gym.error.ResetNeeded, match=r"vehicles \[0, 1, 2, 3, 4\] have ended"):
        envs.step(np.zeros((N, 2)))
    with pytest.raises(ValueError, match="reset_mask"):
        envs.reset(options={"reset_mask": [1, 0]})
