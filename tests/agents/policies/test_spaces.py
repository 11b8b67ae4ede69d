"""Spaces: features and states, single and stacked, are flown as the training's wrappers would have shown them."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import FrameStackObservation
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack

from agents import fly, policies
from agents.policies.spaces import Layout, Stacked, fit, layout, layouts
from agents.training.vec_env import make_vec_env
from flatgym.envs.spaces import observation_space

KINDS = ("features", "state")


class Recorder:
    """Acts by a fixed function of what it sees, and keeps what it has seen."""

    def __init__(self, space):
        self.observation_space, self.seen = space, []

    def predict(self, observation, state=None, episode_start=None, deterministic=False):  # noqa: ARG002
        self.seen.append(observation.copy())
        flat = observation.reshape(len(observation), -1)
        return np.tanh(np.stack([flat.sum(axis=1) * 0.1, flat[:, -1]], axis=1)), state


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("frames", [1, 2, 4])
def test_frames_are_those_of_vec_frame_stack(kind, frames):
    def single():
        return gym.make("FlatQuad-v0", scenario="horizontal-3", observation=kind, reward="sparse")

    envs = VecFrameStack(DummyVecEnv([single]), frames)
    assert layout(envs.observation_space, exact=True) == Layout(kind, frames)
    policy, seen = Recorder(envs.observation_space), [envs.reset()]
    steps = fly(policy, "horizontal-3").steps[0]
    for _ in range(steps - 1):
        seen.append(envs.step(Recorder(None).predict(seen[-1])[0].astype(np.float32))[0])
    np.testing.assert_allclose(np.array(policy.seen[:steps]), np.array(seen), atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_those_of_frame_stack_observation(kind):
    env = FrameStackObservation(gym.make("FlatQuad-v0", scenario="horizontal-3", observation=kind), 3)
    assert layout(env.observation_space, exact=True) == Layout(kind, 3, joined=False)
    policy, seen = Recorder(env.observation_space), [env.reset()[0]]
    steps = fly(policy, "horizontal-3").steps[0]
    for _ in range(steps - 1):
        seen.append(env.step(Recorder(None).predict(seen[-1][None])[0][0].astype(np.float32))[0])
    np.testing.assert_allclose(np.array(policy.seen[:steps])[:, 0], np.array(seen), atol=1e-6)


def test_each_vehicle_has_its_own_frames_and_forgets_them_at_the_start():
    policy = Stacked(Recorder(None), Layout("state", 2))
    first, second = np.arange(10.0).reshape(2, 5), np.arange(10.0, 20.0).reshape(2, 5)
    _, state = policy.predict(first, episode_start=np.ones(2, dtype=bool))
    policy.predict(second, state, np.array([True, False]))
    policy.predict(second, state)
    blank, begun, going = policy.policy.seen
    np.testing.assert_array_equal(blank, np.hstack([np.zeros((2, 5)), first]))
    np.testing.assert_array_equal(begun, [[0] * 5 + [*second[0]], [*first[1], *second[1]]])
    np.testing.assert_array_equal(going, np.hstack([first, second]))


def test_bounds_tell_five_frames_of_features_from_nineteen_of_states():
    assert [one.observation for one in layouts((95,))] == ["features", "state"]
    for wanted in (Layout("features", 5), Layout("state", 19)):
        assert layout(wanted.space, exact=True) == wanted


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("stack", [1, 3])
def test_a_zip_is_flown_in_the_space_it_was_trained_in(tmp_path, kind, stack):
    envs = VecFrameStack(make_vec_env("horizontal-3", 2, observation=kind), stack)
    model = PPO("MlpPolicy", envs, n_steps=8, batch_size=8, device="cpu", seed=0)
    found = policies.load(policies.save(model, tmp_path / "stack.zip"), trust=True)
    assert fit(found)[1] == kind
    assert len(policies.describe(tmp_path / "stack.zip")["observations"]) == observation_space(kind).shape[0]
    np.testing.assert_array_equal(fly(found, "drop").actions[0], fly(model, "drop").actions[0])


@pytest.mark.parametrize("shape", [(4,), (20,), (0,), (), (2, 4), (2, 3, 19)])
def test_other_shapes_are_refused_with_both_shapes(shape):
    space = gym.spaces.Box(-1, 1, shape)
    with pytest.raises(ValueError, match=r"observation_space of shape \(.*\(19,\) for features or \(5,\) for state"):
        fly(Recorder(space), "hoop")


def test_a_dictionary_of_observations_is_refused():
    with pytest.raises(ValueError, match="observation_space of shape None"):
        fly(Recorder(gym.spaces.Dict({"a": gym.spaces.Box(-1, 1, (19,))})), "hoop")


@pytest.mark.parametrize("bound", [np.inf, 2.0])
def test_a_zip_trained_behind_a_wrapper_that_changes_observations_is_refused(tmp_path, bound):
    class Changed(gym.ObservationWrapper):
        observation_space = gym.spaces.Box(-bound, bound, (19,), np.float32)

        def observation(self, observation):
            return observation

    envs = DummyVecEnv([lambda: Changed(gym.make("FlatQuad-v0"))])
    PPO("MlpPolicy", envs, n_steps=8, batch_size=8, device="cpu").save(tmp_path / "changed.zip")
    with pytest.raises(ValueError, match=r"changed.zip does not fit.*other bounds.*such as NormalizeObservation"):
        policies.load(tmp_path / "changed.zip", trust=True)


def test_a_zip_with_other_actions_is_refused(tmp_path):
    class Changed(gym.ActionWrapper):
        action_space = gym.spaces.Box(0, 1, (2,), np.float32)

        def action(self, action):
            return 2 * action - 1

    envs = DummyVecEnv([lambda: Changed(gym.make("FlatQuad-v0"))])
    PPO("MlpPolicy", envs, n_steps=8, batch_size=8, device="cpu").save(tmp_path / "changed.zip")
    with pytest.raises(ValueError, match=r"does not fit.*action_space.*Box\(0.0, 1.0, \(2,\).*Box\(-1.0, 1.0"):
        policies.load(tmp_path / "changed.zip", trust=True)
