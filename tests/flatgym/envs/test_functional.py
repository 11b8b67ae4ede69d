"""Gymnasium's functional API: the verbs repeat the scalar environment, and Gymnasium's JAX environments run on them."""

import gymnasium as gym
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.envs.functional_jax_env import FunctionalJaxEnv, FunctionalJaxVectorEnv

from flatgym import DISTRIBUTIONS, OUTCOMES
from flatgym.envs.functional import OUTCOME, SCENE, STATE, FlatQuadFuncEnv


@pytest.fixture(scope="module")
def drawn():
    return FlatQuadFuncEnv("random-hoops")


def test_the_verbs_repeat_the_scalar_environment(drawn):
    env, key = gym.make("FlatQuad-v0", scenario="random-hoops").unwrapped, jax.random.PRNGKey(7)
    observation, _ = env.reset(seed=7)
    state = drawn.initial(key)
    np.testing.assert_allclose(drawn.observation(state, key), observation, atol=1e-5)
    generator = np.random.default_rng(0)
    for _ in range(20):
        action = generator.uniform(-1.2, 1.2, 2)
        after = drawn.transition(state, action, key)
        observation, reward, terminated, _, info = env.step(action)
        np.testing.assert_allclose(drawn.observation(after, key), observation, atol=1e-5)
        np.testing.assert_allclose(drawn.reward(state, action, after, key), reward, atol=1e-4)
        assert bool(drawn.terminal(after, key)) == terminated
        ours = drawn.transition_info(state, action, after)
        np.testing.assert_allclose(ours["state"], info["state"], atol=1e-4)
        assert [int(ours[name]) for name in ("steps", "hoops_passed")] == [info["steps"], info["hoops_passed"]]
        assert OUTCOMES[int(ours["outcome"])] == info["outcome"]
        state = after


def test_seed_and_episode_give_the_same_task_as_numpy():
    goals, seed, episode = FlatQuadFuncEnv("random-goal"), 5 * 2**32 + 3, 4
    state = goals.initial(jnp.asarray([5, 3, 0, 4], dtype=jnp.uint32))
    row = DISTRIBUTIONS["random-goal"].draw(np.array([seed], dtype=np.uint64), np.array([episode], dtype=np.uint64))[0]
    np.testing.assert_allclose(state[SCENE:], row, atol=1e-5)
    np.testing.assert_array_equal(goals.initial(jax.random.key(3)), goals.initial(jax.random.PRNGKey(3)))


def test_params_are_another_scenario_and_never_arrays(drawn):
    key, hoop = jax.random.PRNGKey(0), DISTRIBUTIONS["random-goal"].scenario(1)
    state = drawn.initial(key, hoop)
    assert state.shape == (SCENE,)
    assert drawn.observation(drawn.transition(state, jnp.zeros(2), key, hoop), key, hoop).shape == (19,)
    with pytest.raises(TypeError, match="params are plain values, not arrays"):
        jax.vmap(lambda params: FlatQuadFuncEnv.initial(drawn, key, params))(jnp.zeros(3))


def test_gymnasiums_environment_runs_and_a_nan_ends_its_episode(drawn):
    env = FunctionalJaxEnv(drawn)
    observation, info = env.reset(seed=1)
    assert np.asarray(observation) in env.observation_space
    assert OUTCOMES[int(info["outcome"])] == "flying"
    assert not env.step(jnp.zeros(2))[2]
    _, reward, terminated, truncated, info = env.step(jnp.asarray([jnp.nan, 0.0]))
    assert terminated
    assert not truncated
    assert np.isfinite(reward)
    assert OUTCOMES[int(info["outcome"])] == "out-of-bounds"


def test_gymnasiums_vector_environment_runs_and_resets():
    envs = FunctionalJaxVectorEnv(FlatQuadFuncEnv("random-goal", "sparse", "state"), num_envs=4, max_episode_steps=3)
    observations, _ = envs.reset(seed=0)
    assert observations.shape == (4, 5)
    for i in range(5):
        observations, rewards, terminated, truncated, infos = envs.step(jnp.zeros((4, 2)))
        assert observations.dtype == jnp.float32
        assert rewards.shape == terminated.shape == infos["outcome"].shape == (4,)
        assert truncated.all() == (i == 2)
    assert (envs.state[:, OUTCOME] == 0).all()
    assert np.isfinite(envs.state[:, STATE]).all()
