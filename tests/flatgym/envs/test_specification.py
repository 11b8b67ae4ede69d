"""Specifications: plain data, from which Gymnasium makes an equal environment; the limit of steps they state."""

import json
from dataclasses import asdict, replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TimeAwareObservation
from sb3_contrib.common.wrappers import TimeFeatureWrapper

from flatgym import DISTRIBUTIONS, SCENARIOS, Distribution, Hoop, Quadrotor, Scenario
from flatgym.envs.config import Starts
from flatgym.scenarios.files import to_text

OWN = Scenario(
    "own", (0, 0), (4, 1), (Hoop(2, 0.5, 1, 0.3),), floor=-1, quadrotor=Quadrotor(thrust_max=15), dt=0.04, time_limit=2
)
TRACK = Distribution("my-tracks", least_distance=1.5, hoops=(2, 3), leg=(2.0, 3.0), dt=0.03)
ARGUMENTS = {
    "named": {"scenario": "slalom"},
    "scenario": {"scenario": OWN},
    "distribution": {"scenario": TRACK},
    "named distribution": {"scenario": DISTRIBUTIONS["random-hoops"], "reward": "sparse"},
    "disturbances": {"scenario": OWN, "wind": np.float32(0.5), "action_delay": np.int64(2), "sensor_noise": 0.01},
    "starts": {"scenario": OWN, "starts": Starts(np.eye(5), np.array([0, 1, 0, 1, 0]), 0.7)},
    "ghost": {"scenario": OWN, "ghost": np.eye(5), "render_mode": "rgb_array"},
    "ghost of lists": {"ghost": [tuple(row) for row in np.eye(5)]},
    "state": {"observation": np.str_("state")},
}


def flight(env, seed=5):
    """Return all observations, rewards and flags of an episode of fixed actions."""
    results, generator = [env.reset(seed=seed)[0]], np.random.default_rng(0)
    for _ in range(15):
        observation, *rest, _ = env.step(generator.uniform(-1, 1, env.action_space.shape).astype(np.float32))
        results += [observation, *rest]
        if np.any(rest[1] | rest[2]):
            break
    return results


def hover(env, steps):
    """Return the results of hovering."""
    action = env.unwrapped.scenario.quadrotor.action([9.81, 0.0]).astype(np.float32)
    env.reset(seed=0)
    return [env.step(action) for _ in range(steps)]


@pytest.mark.parametrize("arguments", ARGUMENTS.values(), ids=ARGUMENTS)
def test_a_specification_survives_json_and_makes_an_equal_environment(arguments):
    env = gym.make("FlatQuad-v0", **arguments)
    spec = EnvSpec.from_json(env.spec.to_json())
    again = gym.make(spec)
    assert spec == env.spec == again.spec
    assert again.unwrapped.fleet.config.problem == env.unwrapped.fleet.config.problem
    assert np.array_equal(again.unwrapped.recorder.ghost, env.unwrapped.recorder.ghost)
    for one, other in zip(flight(env), flight(again), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", ["scenario", "distribution", "disturbances", "starts"])
def test_so_does_that_of_the_batched_environment(name):
    arguments = ARGUMENTS[name] | {"autoreset_mode": AutoresetMode.SAME_STEP, "max_episode_steps": np.int64(9)}
    envs = gym.make_vec("FlatQuad-v0", num_envs=3, **arguments)
    spec = EnvSpec.from_json(envs.spec.to_json())
    again = gym.make_vec(spec)
    assert again.spec == spec == envs.spec
    assert (again.num_envs, again.autoreset_mode, again.config.last_step) == (3, AutoresetMode.SAME_STEP, 9)
    assert again.scenario == envs.scenario
    for one, other in zip(flight(envs), flight(again), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_file_is_stored_by_its_content(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(to_text(OWN, ".toml"))
    spec = gym.make("FlatQuad-v0", scenario=path).spec
    path.unlink()
    assert gym.make(EnvSpec.from_json(spec.to_json())).unwrapped.scenario == OWN


@pytest.mark.parametrize("task", [OWN, TRACK, SCENARIOS["loop"]], ids=lambda task: task.name)
def test_dicts_of_tasks_are_tasks(task):
    for data in (task.to_dict(), json.loads(json.dumps(asdict(task)))):  # the latter is what datasets hold
        assert gym.make("FlatQuad-v0", scenario=data).unwrapped.fleet.config.problem == task


def test_damaged_dicts_are_named():
    with pytest.raises(ValueError, match="no field 'gaol'"):
        gym.make("FlatQuad-v0", scenario=OWN.to_dict() | {"gaol": [1, 2]})
    with pytest.raises(ValueError, match="no field 'turns'"):
        gym.make("FlatQuad-v0", scenario=TRACK.to_dict() | {"turns": 3})
    with pytest.raises(ValueError, match=r"not a pool of starts: .*'states'"):
        gym.make("FlatQuad-v0", starts={"states": [[0] * 5]})
    with pytest.raises(ValueError, match=r"Starts.state must have shape \(m, 5\)"):
        gym.make("FlatQuad-v0", starts={"state": [0] * 5})


# The limit of steps


@pytest.mark.parametrize("scenario", ["hoop", OWN, TRACK, "random-track"])
def test_the_specification_states_the_limit_of_the_scenario(scenario):
    env = gym.make("FlatQuad-v0", scenario=scenario)
    problem = env.unwrapped.fleet.config.problem
    assert env.spec.max_episode_steps == problem.max_steps
    envs = gym.make_vec("FlatQuad-v0", num_envs=2, scenario=scenario)
    assert envs.spec.max_episode_steps == problem.max_steps


def test_wrappers_that_need_the_limit_find_it():
    env = gym.make("FlatQuad-v0", scenario=OWN)
    aware, feature = (
        TimeAwareObservation(env, normalize_time=True),
        TimeFeatureWrapper(gym.make("FlatQuad-v0", scenario=OWN)),
    )
    assert aware.max_timesteps == 50
    shares = [result[0][-1] for result in hover(aware, 50)]
    np.testing.assert_allclose(shares, np.arange(1, 51) / 50)
    np.testing.assert_allclose([result[0][-1] for result in hover(feature, 50)], 1 - np.arange(1, 51) / 50, atol=1e-7)


def test_episodes_are_truncated_once_also_where_gymnasium_limits_them_too():
    env = gym.make("FlatQuad-v0", scenario=OWN)
    for one in (env, gym.make(EnvSpec.from_json(env.spec.to_json())), gym.make(env.spec, max_episode_steps=-1)):
        flags = [(terminated, truncated) for _, _, terminated, truncated, _ in hover(one, 49)]
        assert set(flags) == {(False, False)}
        *_, terminated, truncated, info = one.step(np.zeros(2, np.float32))
        assert (terminated, truncated, info["outcome"], info["steps"]) == (False, True, "time-limit", 50)
        with pytest.raises(gym.error.ResetNeeded):
            one.step(np.zeros(2, np.float32))


def test_a_goal_at_the_last_step_is_a_goal():
    last = replace(SCENARIOS["hoop"], time_limit=0.02)
    env = gym.make("FlatQuad-v0", scenario=last)
    for one in (env, gym.make(EnvSpec.from_json(env.spec.to_json()))):
        one.reset(options={"state": last.goal_state, "hoops_passed": 1})
        _, _, terminated, _, info = one.step(last.quadrotor.action([9.81, 0.0]).astype(np.float32))
        assert (terminated, info["outcome"], info["is_success"]) == (True, "goal", True)


def test_without_gymnasiums_make_there_is_no_specification():
    from flatgym.envs.env import FlatQuadEnv
    from flatgym.envs.vector import FlatQuadVectorEnv

    assert FlatQuadEnv().spec is FlatQuadVectorEnv(2).spec is None
    registered = gym.spec("FlatQuad-v0")
    env = FlatQuadEnv()
    env.spec = registered
    assert (env.spec.max_episode_steps, registered.max_episode_steps) == (250, None)
