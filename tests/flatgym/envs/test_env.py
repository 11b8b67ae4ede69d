"""FlatQuad-v0: the requirements of Gymnasium and SB3, and clear errors for misuse."""

import copy
import math
import pickle
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import PackageNotFoundError

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_sb3
from stable_baselines3.common.env_util import make_vec_env

from flatgym import DISTRIBUTIONS, OBSERVATION_NAMES, OUTCOMES, SCENARIOS, Hoop, observation_names
from flatgym.envs.config import Starts
from flatgym.envs.env import FlatQuadEnv
from flatgym.envs.vector import FlatQuadVectorEnv
from flatgym.scenarios.reference import ghost_states, reference

INFO_KEYS = {"state", "time", "steps", "hoops_passed", "is_success", "outcome", "k_star"}


@pytest.mark.parametrize(
    "arguments",
    [
        *({"scenario": task} for task in (*SCENARIOS, *DISTRIBUTIONS)),
        {"scenario": replace(SCENARIOS["slalom"], dt=0.01)},
        {"scenario": replace(DISTRIBUTIONS["random-hoops"], time_limit=3.0)},
        {"scenario": "random-goal", "wind": 1.0, "action_delay": 2, "sensor_noise": 0.01},
        {"starts": Starts(np.zeros((3, 5)))},
    ],
    ids=str,
)
def test_environment_checkers_of_gymnasium_and_sb3_pass(arguments, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gym.make("FlatQuad-v0", **arguments).unwrapped
    check_env(env)
    check_env_sb3(env)


@pytest.mark.parametrize("scenario", [replace(SCENARIOS["hoop"], dt=0.01), "random-goal"], ids=["own", "sampled"])
def test_an_unknown_k_star_is_zero_in_every_kind_of_batch(scenario):
    single = gym.make("FlatQuad-v0", scenario=scenario)
    batches = [gym.make_vec("FlatQuad-v0", 2, mode, scenario=scenario) for mode in ("sync", "vector_entry_point")]
    assert single.reset(seed=3)[1]["k_star"] == single.step(np.zeros(2, np.float32))[4]["k_star"] == 0
    for envs in batches:
        for infos in (envs.reset(seed=3)[1], envs.step(np.zeros((2, 2), np.float32))[4]):
            assert (infos["k_star"].tolist(), infos["k_star"].dtype) == ([0, 0], np.int64)


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


def test_reset_options_set_the_start():
    env = gym.make("FlatQuad-v0", scenario="hoop")
    observation, info = env.reset(options={"state": [4.9, 5.0, 0, 0, 0], "hoops_passed": 1})
    assert len(observation) == len(OBSERVATION_NAMES)
    np.testing.assert_array_equal(info["state"], [4.9, 5.0, 0, 0, 0])
    hover = env.unwrapped.scenario.quadrotor.action([9.81, 0.0]).astype(np.float32)
    _, _, terminated, _, info = env.step(hover)
    assert terminated
    assert info["outcome"] == "goal"


def test_finite_actions_outside_the_box_are_clipped():
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
def test_invalid_actions_are_rejected(action, words):
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
def test_invalid_reset_options_are_rejected(options, words):
    with pytest.raises(ValueError, match=words):
        gym.make("FlatQuad-v0").unwrapped.reset(options=options)


def test_steps_before_reset_and_after_the_end_raise_reset_needed():
    env = gym.make("FlatQuad-v0").unwrapped
    with pytest.raises(gym.error.ResetNeeded, match="call reset"):
        env.step(np.zeros(2))
    env.reset(options={"state": [5, 5, 0, 0, 0], "hoops_passed": 1})
    env.step(env.scenario.quadrotor.action([9.81, 0.0]))
    with pytest.raises(gym.error.ResetNeeded, match=r"the episode has ended \('goal'\)"):
        env.step(np.zeros(2))


def test_unknown_argument_values_are_rejected():
    with pytest.raises(ValueError, match="unknown scenario 'hop'"):
        gym.make("FlatQuad-v0", scenario="hop")
    with pytest.raises(ValueError, match="unknown reward 'dense'; known: shaped, sparse"):
        gym.make("FlatQuad-v0", reward="dense")


def test_unknown_arguments_are_named():
    with pytest.raises(TypeError, match="unexpected keyword argument 'colour'"):
        gym.make("FlatQuad-v0", colour="red")
    with pytest.raises(TypeError, match="unexpected keyword argument 'colour'"):
        FlatQuadVectorEnv(2, colour="red")
    with pytest.raises(ValueError, match="unknown autoreset_mode 'Later'; known: 'NextStep', 'SameStep', 'Disabled'"):
        FlatQuadVectorEnv(2, autoreset_mode="Later")


@pytest.mark.parametrize("num_envs", [0, -1, 2.5, True, "3", None])
def test_num_envs_must_be_a_positive_integer(num_envs):
    with pytest.raises(ValueError, match="num_envs must be"):
        FlatQuadVectorEnv(num_envs)


def test_huge_finite_actions_are_clipped():
    env = FlatQuadEnv()
    env.reset()
    huge = env.step(np.full(2, np.finfo(np.float64).max))[0]
    env.reset()
    np.testing.assert_array_equal(huge, env.step(np.ones(2))[0])


@pytest.mark.parametrize("action", ["up", [None, 0.0], [[0.0], 1.0], [10**400, 0], np.array([1j, 0])])
def test_nonnumeric_actions_are_rejected_without_a_step(action):
    env = FlatQuadEnv()
    _, info = env.reset()
    with pytest.raises(ValueError, match="actions must be an array of numbers"):
        env.step(action)
    assert env.step(np.zeros(2))[4]["steps"] == info["steps"] + 1


# Observations and infos


@pytest.mark.parametrize("observation", ["features", "state"])
def test_every_component_of_an_observation_has_a_name(observation):
    env = FlatQuadEnv(observation=observation)
    assert env.reset()[0].shape == env.observation_space.shape == (len(observation_names(observation)),)
    assert len(set(observation_names(observation))) == len(observation_names(observation))
    assert observation_names() == OBSERVATION_NAMES


def test_the_observed_state_is_that_of_info(generator):
    env, envs = FlatQuadEnv(observation="state"), FlatQuadVectorEnv(3, observation="state")
    for one in (env, envs):
        observation, info = one.reset(seed=0)
        for _ in range(20):
            np.testing.assert_array_equal(observation, info["state"].astype(np.float32))
            observation, *_, info = one.step(generator.uniform(-1, 1, one.action_space.shape))


def test_returned_values_do_not_change_later(generator):
    for env in (FlatQuadEnv("random-goal"), FlatQuadVectorEnv(3, "random-goal", autoreset_mode="SameStep")):
        reported = [env.reset(seed=0)]
        for _ in range(30):
            reported.append(env.step(generator.uniform(-1, 1, env.action_space.shape)))
            if len(reported) == 2:
                copies = copy.deepcopy(reported)
        env.reset()
        for then, now in zip(copies, reported, strict=False):
            for one, other in zip(then[:-1], now[:-1], strict=True):
                np.testing.assert_array_equal(one, other)
            assert then[-1].keys() == now[-1].keys()
            np.testing.assert_equal(then[-1], now[-1])


def test_a_ghost_needs_a_named_scenario_or_states():
    other = replace(SCENARIOS["hoop"], dt=0.01)
    for scenario in (other, DISTRIBUTIONS["random-hoops"]):
        with pytest.raises(ValueError, match=r"no K\*-step solution is stored .*; give states of shape \(K\+1, 5\)"):
            FlatQuadEnv(scenario, ghost=True)
    FlatQuadEnv(other, ghost=ghost_states("hoop"))
    for ghost, words in (("fast", "the ghost must be an array of numbers"), (np.zeros(5), r"of shape \(K\+1, 5\)")):
        with pytest.raises(ValueError, match=words):
            FlatQuadEnv(ghost=ghost)
    with pytest.raises(ValueError, match="unknown render_mode 'ascii'; known: human, rgb_array"):
        FlatQuadEnv(render_mode="ascii")


# Copies


@pytest.mark.parametrize("make", [FlatQuadEnv, lambda *kind: FlatQuadVectorEnv(3, *kind)], ids=["scalar", "batched"])
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_within_an_episode_continues_as_the_original(make, duplicate, generator):
    env = make("random-hoops")
    env.reset(seed=3)
    env.step(env.action_space.high)
    twin = duplicate(env)
    for _ in range(5):
        actions = generator.uniform(-1, 1, env.action_space.shape)
        (seen, *_, infos), (other, *_, reported) = env.step(actions), twin.step(actions)
        np.testing.assert_array_equal(seen, other)
        np.testing.assert_array_equal(infos["state"], reported["state"])
        assert make is FlatQuadEnv or not reported["_state"].flags.writeable
    np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])


def test_processes_give_the_same_episodes():
    envs = gym.make_vec("FlatQuad-v0", 2, "async", scenario="random-goal")
    try:
        observation, _ = envs.reset(seed=5)
        flown = envs.step(np.zeros((2, 2), np.float32))[0]
    finally:
        envs.close()
    batch = FlatQuadVectorEnv(2, "random-goal")
    np.testing.assert_array_equal(observation, batch.reset(seed=5)[0])
    np.testing.assert_array_equal(flown, batch.step(np.zeros((2, 2)))[0])


# Pictures


@pytest.mark.parametrize("scenario", ["hoop", "random-hoops"])
@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_draws_what_the_original_draws(scenario, duplicate):
    env = gym.make("FlatQuad-v0", scenario=scenario, render_mode="rgb_array")
    env.reset(seed=3)
    env.step(env.action_space.high)
    env.render()
    twin = duplicate(env)
    for one in (env, twin):
        one.step(one.action_space.low)
    np.testing.assert_array_equal(twin.render(), env.render())


@pytest.mark.parametrize("mode", ["rgb_array", "human"])
def test_a_closed_environment_can_be_reset_and_rendered(mode, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gym.make("FlatQuad-v0", render_mode=mode)
    drawn = []
    for _ in range(2):
        env.reset(seed=0)
        env.step(env.action_space.high)
        drawn.append(env.render())
        assert env.unwrapped.recorder._renderer.is_open
        env.close()
        env.close()
    np.testing.assert_array_equal(*drawn)


@pytest.mark.parametrize(("dt", "rate"), [(0.02, 50.0), (0.005, 200.0), (0.04, 25.0), (0.03, 1 / 0.03)])
def test_films_run_at_the_rate_of_the_steps(dt, rate):
    scenarios = replace(SCENARIOS["hoop"], dt=dt), replace(DISTRIBUTIONS["random-goal"], dt=dt)
    for env in (gym.make("FlatQuad-v0", scenario=scenario) for scenario in scenarios):
        assert env.metadata["render_fps"] == env.unwrapped.metadata["render_fps"] == rate
    assert FlatQuadEnv.metadata["render_fps"] == 50


def test_without_pygame_only_pictures_fail(monkeypatch):
    monkeypatch.setattr("flatgym.extras.find_spec", lambda _: None)
    command = r"pip install 'flatgym\[render\]'"
    with pytest.warns(UserWarning, match=rf"render\(\) will fail: pygame not installed; run: {command}"):
        env = gym.make("FlatQuad-v0", render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.high)
    with pytest.raises(ImportError, match=command):
        env.render()
    with pytest.raises(ImportError, match=command):
        gym.make("FlatQuad-v0", render_mode="human")
    with pytest.warns(UserWarning, match=command):
        make_vec_env("FlatQuad-v0", n_envs=2).reset()


def test_plain_pygame_is_named(monkeypatch):
    def missing(name):
        raise PackageNotFoundError(name)

    words = "need the package pygame-ce, and the package pygame is installed in its place; run: pip uninstall pygame"
    with monkeypatch.context() as patch:
        patch.setattr("flatgym.rendering.renderer.version", missing)
        with pytest.warns(UserWarning, match=words):
            FlatQuadEnv(render_mode="rgb_array")
    env = FlatQuadEnv(render_mode="rgb_array")
    env.reset()
    monkeypatch.delattr("pygame.IS_CE")  # both packages were installed, one over the other
    with pytest.raises(ImportError, match=words):
        env.render()


# Laws


@pytest.mark.parametrize("name", SCENARIOS)
def test_best_known_solutions_reach_the_goal_in_k_star_steps_with_return_minus_time(name):
    known = reference(name)
    env, envs = FlatQuadEnv(name, "sparse"), FlatQuadVectorEnv(3, name, "sparse", autoreset_mode="SameStep")
    env.reset()
    envs.reset()
    total, totals = 0.0, np.zeros(3)
    for k, action in enumerate(known.actions, 1):
        _, reward, terminated, truncated, info = env.step(action)
        _, rewards, *flags, infos = envs.step(np.tile(action, (3, 1)))
        total, totals = total + reward, totals + rewards
        assert (terminated, truncated) == (k == known.k_star, False)
        assert np.all(flags[0] == terminated)
        assert not flags[1].any()
    assert (info["outcome"], info["steps"], info["is_success"]) == ("goal", known.k_star, True)
    final = infos["final_info"]
    assert (final["outcome"].tolist(), final["steps"].tolist()) == (["goal"] * 3, [known.k_star] * 3)
    np.testing.assert_allclose([-total, *-totals], known.k_star * env.scenario.dt, rtol=1e-12)


MIRRORED = np.array([-1.0 if name.endswith("_x") or name == "sin_theta" else 1.0 for name in OBSERVATION_NAMES])


def mirrored(scenario):
    """The same scenario seen from behind."""
    return replace(
        scenario,
        start=(-scenario.start[0], scenario.start[1]),
        goal=(-scenario.goal[0], scenario.goal[1]),
        hoops=tuple(Hoop(-hoop.x, hoop.z, hoop.diameter, math.pi - hoop.angle) for hoop in scenario.hoops),
    )


@pytest.mark.parametrize("name", ["ground-6", "slalom", "loop"])
def test_mirrored_actions_solve_the_mirrored_scenario(name, generator):
    known, flights = reference(name).actions, generator.uniform(-1, 1, (5, len(reference(name).actions), 2))
    envs, others = (FlatQuadVectorEnv(6, scenario) for scenario in (SCENARIOS[name], mirrored(SCENARIOS[name])))
    seen, image = envs.reset(seed=0), others.reset(seed=0)
    for actions in np.concatenate([known[None], flights]).transpose(1, 0, 2):
        np.testing.assert_allclose(seen[0], image[0] * MIRRORED, atol=1e-6)
        seen, image = envs.step(actions), others.step(actions * [1, -1])
        np.testing.assert_allclose(seen[1], image[1], atol=1e-9)
        for one, other in zip(seen[2:4], image[2:4], strict=True):
            np.testing.assert_array_equal(one, other)
        np.testing.assert_allclose(seen[4]["state"], image[4]["state"] * [-1, 1, -1, 1, -1], atol=1e-9)
        np.testing.assert_array_equal(seen[4]["hoops_passed"], image[4]["hoops_passed"])
    assert seen[4]["outcome"][0] == "goal"


def test_a_failed_episode_pays_the_remaining_time_limit():
    env = FlatQuadEnv("ground-6", "sparse")
    env.reset()
    total, terminated = 0.0, False
    while not terminated:
        _, reward, terminated, _, info = env.step(env.action_space.low)
        total += reward
    assert info["outcome"] == "floor"
    assert math.isclose(-total, env.scenario.time_limit)


# Import


def test_import_loads_nothing_heavy():
    code = (
        "import sys, flatgym; print([m for m in ('casadi', 'torch', 'numba', 'pygame', 'pandas') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
