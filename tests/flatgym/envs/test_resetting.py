"""Start of episodes: functions of seed and number only; invalid seeds and options are named."""

import gymnasium as gym
import numpy as np
import pytest

from flatgym import SCENARIOS, Disturbances
from flatgym.envs.config import Starts
from flatgym.envs.env import FlatQuadEnv
from flatgym.envs.resetting import OPTIONS, check_options, check_seed
from flatgym.envs.vector import FlatQuadVectorEnv

N, EPISODES = 4, 6
BAD_SEEDS = [-1, 1.5, True, 2**63, 2**200, "7", {}, int, np.nan]
NOISY = {"wind": 2.0, "mass": 0.2, "action_delay": 3, "sensor_noise": 0.01}
KINDS = {
    "random-hoops": {"scenario": "random-hoops"},
    "disturbed": {"scenario": "hoop", **NOISY},
    "starts": {"scenario": "hoop", "starts": Starts(np.random.default_rng(0).normal(0, 0.1, (50, 5)), share=0.5)},
}


def first_observations(kind, seed):
    """The first observations of the first episodes of a scalar environment."""
    env = FlatQuadEnv(**KINDS[kind])
    return [env.reset(seed=seed if episode == 0 else None)[0] for episode in range(EPISODES)]


@pytest.mark.parametrize("kind", KINDS)
def test_an_episode_is_a_function_of_seed_and_number_only(kind, generator):
    expected = first_observations(kind, 5)
    assert len({observation.tobytes() for observation in expected}) > 1
    env = FlatQuadEnv(**KINDS[kind])
    for episode, observation in enumerate(expected):
        np.testing.assert_array_equal(env.reset(seed=5 if episode == 0 else None)[0], observation)
        for _ in range(generator.integers(4)):
            env.step(generator.uniform(-1, 1, 2))


@pytest.mark.parametrize("mode", ["SameStep", "NextStep", "Disabled"])
@pytest.mark.parametrize("kind", KINDS)
def test_vehicle_i_repeats_the_scalar_environment_seeded_with_s_plus_i(kind, mode, generator):
    envs = FlatQuadVectorEnv(N, **KINDS[kind], autoreset_mode=mode, max_episode_steps=3)
    firsts = [envs.reset(seed=5)[0]]
    while len(firsts) < EPISODES:
        observation, _, _, truncated, _ = envs.step(generator.uniform(-1, 1, (N, 2)))
        if truncated.all():
            if mode == "NextStep":
                observation = envs.step(generator.uniform(-1, 1, (N, 2)))[0]
            if mode == "Disabled":
                observation = envs.reset()[0]
            firsts.append(observation)
    for i in range(N):
        np.testing.assert_array_equal([first[i] for first in firsts], first_observations(kind, 5 + i))


def test_a_list_seeds_each_vehicle_and_none_samples_a_seed():
    seeds = [3, 1, 4, 1]
    observation, _ = FlatQuadVectorEnv(N, "random-goal").reset(seed=seeds)
    for i, seed in enumerate(seeds):
        np.testing.assert_array_equal(observation[i], FlatQuadEnv("random-goal").reset(seed=seed)[0])
    partly, _ = FlatQuadVectorEnv(N, "random-goal").reset(seed=[3, None, 4, None])
    np.testing.assert_array_equal(partly[[0, 2]], observation[[0, 2]])
    assert np.any(partly[1] != partly[3])


def test_without_a_seed_environments_differ():
    drawn = [FlatQuadEnv("random-goal").reset()[0] for _ in range(2)]
    drawn += [FlatQuadVectorEnv(2, "random-goal").reset()[0][i] for i in range(2)]
    assert len({observation.tobytes() for observation in drawn}) == 4


def test_a_masked_reset_starts_the_next_episode_of_the_masked_vehicles_only():
    envs = FlatQuadVectorEnv(N, "random-goal", autoreset_mode="Disabled")
    first, _ = envs.reset(seed=5)
    mask = np.array([True, False, False, True])
    second, _ = envs.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(second[1:3], first[1:3])
    for i in (0, 3):
        env = FlatQuadEnv("random-goal")
        env.reset(seed=5 + i)
        np.testing.assert_array_equal(second[i], env.reset()[0])
    fresh = FlatQuadVectorEnv(N, "random-goal", autoreset_mode="Disabled")
    with pytest.raises(gym.error.ResetNeeded, match=r"first reset.*must start all episodes"):
        fresh.reset(options={"reset_mask": mask})


@pytest.mark.parametrize("seed", BAD_SEEDS, ids=repr)
def test_invalid_seeds_are_named_and_change_nothing(seed):
    with pytest.raises(ValueError, match=r"a seed must be a whole number in 0\.\.2\^63 - 1, got "):
        check_seed(seed)
    for make, bad in ((FlatQuadEnv, seed), (lambda **kind: FlatQuadVectorEnv(1, **kind), [seed])):
        env, twin = (make(scenario="random-goal") for _ in range(2))
        for one in (env, twin):
            one.reset(seed=1)
        for value in (seed, bad):
            with pytest.raises(ValueError, match="seed must be"):
                env.reset(seed=value)
        np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])


def test_the_number_of_seeds_is_the_number_of_vehicles():
    with pytest.raises(ValueError, match="seed must be one number or 4, got 3"):
        FlatQuadVectorEnv(N).reset(seed=[1, 2, 3])


def test_integer_types_of_seeds_are_equivalent():
    assert [check_seed(seed) for seed in (7, np.int8(7), np.uint64(7))] == [7, 7, 7]
    assert check_seed(2**63 - 1) == 2**63 - 1
    firsts = [FlatQuadVectorEnv(N, "random-goal").reset(seed=seed)[0] for seed in (2, np.array(2), np.arange(2, 2 + N))]
    np.testing.assert_array_equal(firsts[0], firsts[1])
    np.testing.assert_array_equal(firsts[0], firsts[2])


BAD_OPTIONS = [
    ("anywhere", "options must be a dict or None, got 'anywhere'; known: state, hoops_passed"),
    ({"speed": 3}, r"unknown reset options \['speed'\]; known: state, hoops_passed"),
    ({"state": [[0, 0], [0]]}, r"options\['state'\] must be an array of numbers"),
    ({"state": ["a"] * 5}, r"options\['state'\] must be an array of numbers"),
    ({"state": [2e4, 0, 0, 0, 0]}, r"options\['state'\] must be five finite numbers .*, within 10000 of zero"),
    ({"state": np.zeros((3, 5))}, r"options\['state'\] must be five finite numbers"),
    ({"hoops_passed": 9}, r"options\['hoops_passed'\] must lie in 0\.\.\d, got 9"),
    ({"hoops_passed": -1}, r"options\['hoops_passed'\] must lie in 0\.\.\d, got -1"),
    ({"hoops_passed": 0.5}, r"options\['hoops_passed'\] must be a whole number"),
    ({"hoops_passed": True}, r"options\['hoops_passed'\] must be a whole number"),
]


@pytest.mark.parametrize(("options", "words"), BAD_OPTIONS, ids=repr)
@pytest.mark.parametrize("make", [FlatQuadEnv, lambda kind: FlatQuadVectorEnv(2, kind)], ids=["scalar", "batched"])
def test_invalid_options_are_named_and_start_no_episode(make, options, words):
    env, twin = make("random-hoops"), make("random-hoops")
    for one in (env, twin):
        one.reset(seed=1)
    with pytest.raises(ValueError, match=words):
        env.reset(options=options)
    np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])


def test_options_are_copied_and_may_be_none():
    options = {"state": [0.0] * 5}
    assert check_options(None) == {}
    assert check_options(options) == options
    assert check_options(options) is not options
    assert set(OPTIONS) == {"state", "hoops_passed"}


def test_disturbances_belong_to_the_episode_not_to_the_start():
    envs = FlatQuadVectorEnv(3, "hoop", wind=2.0)
    envs.reset(seed=5, options={"state": np.ones((3, 5)), "hoops_passed": np.array([0, 1, 0])})
    infos = envs.step(np.zeros((3, 2)))[4]
    wind = Disturbances(wind=2.0).draw(np.arange(5, 8, dtype=np.uint64), np.zeros(3, dtype=np.uint64))[1]
    calm = FlatQuadEnv("hoop")
    calm.reset(options={"state": np.ones(5)})
    blown = infos["state"][:, 2:4] - calm.step(np.zeros(2))[4]["state"][2:4]
    np.testing.assert_allclose(blown, wind * SCENARIOS["hoop"].dt, atol=1e-12)
    np.testing.assert_array_equal(infos["hoops_passed"], [0, 1, 0])
