"""Progress: tells failed episodes apart, which the shaped return cannot; successes rank by their steps."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.monitor import Monitor

import agents
from agents.training.progress_reward import ProgressReward
from flatgym import SCENARIOS
from flatgym.scenarios.reference import reference
from flatgym.task import initial
from flatgym.task.scene import Scene
from flatgym.task.shaping import potential

UP, TURNING = (1.0, 0.0), (1.0, 0.05)


def flown(name, actions, **arguments):
    """Fly one episode with progress as the reward; return the rewards and the last info."""
    env = ProgressReward(gym.make("FlatQuad-v0", scenario=name, **arguments))
    env.reset(seed=0)
    rewards, info = [], {"outcome": "flying"}
    for action in actions:
        if info["outcome"] != "flying":
            break
        reward, *_, info = env.step(np.array(action, np.float32))[1:]
        rewards.append(reward)
    return rewards, info


def shaped_return(name, action):
    env = gym.make("FlatQuad-v0", scenario=name)
    env.reset(seed=0)
    total, done = 0.0, False
    while not done:
        _, reward, terminated, truncated, info = env.step(np.array(action, np.float32))
        total, done = total + reward, terminated or truncated
    return total, info["outcome"]


@pytest.mark.parametrize("name", ["hoop", "slalom", "horizontal-6"])
def test_the_shaped_return_of_failures_is_a_constant_of_the_start_and_their_progress_is_not(name):
    scene = Scene.of([SCENARIOS[name]])
    constant = -SCENARIOS[name].time_limit - float(potential(scene, initial(scene))[0])
    for action in (UP, TURNING):
        total, outcome = shaped_return(name, action)
        assert outcome == "out-of-bounds"
        assert total == pytest.approx(constant, abs=1e-9)
    progress = [flown(name, [action] * 250)[1]["progress"] for action in (UP, TURNING)]
    assert abs(progress[0] - progress[1]) > 0.01
    assert all(0 <= value < 1 for value in progress)


@pytest.mark.parametrize("name", ["hoop", "slalom", "loop"])
def test_the_return_is_the_last_progress_and_never_falls(name):
    best = reference(name)
    for part in (len(best.actions), len(best.actions) // 2):
        rewards, info = flown(name, best.actions[:part])
        assert min(rewards) >= 0
        assert sum(rewards) == pytest.approx(info["progress"], abs=1e-12)
        if part == best.k_star:
            assert info["progress"] == 2 - best.k_star / SCENARIOS[name].max_steps
        else:
            assert 0 < info["progress"] < 1


def test_an_evaluation_of_an_untrained_policy_shows_its_progress(tmp_path):
    env = Monitor(ProgressReward(gym.make("FlatQuad-v0", scenario="hoop")), info_keywords=("hoops_passed", "progress"))
    model = PPO("MlpPolicy", agents.make_vec_env("hoop", 4, seed=0), n_steps=16, batch_size=64, seed=0, device="cpu")
    seen = EvalCallback(env, n_eval_episodes=1, eval_freq=1, log_path=str(tmp_path), verbose=0)
    with pytest.warns(UserWarning, match="not of the same type"):  # as for every batch beside a single environment
        model.learn(1, callback=seen)
    assert 0 <= seen.last_mean_reward < 1
    assert seen.last_mean_reward == pytest.approx(env.get_episode_rewards()[-1], abs=1e-5)
