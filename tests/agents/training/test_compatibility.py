"""Compatibility: Gymnasium wrappers, Stable-Baselines3, a CleanRL loop and Minari on the environments."""

import json
from dataclasses import asdict
from itertools import pairwise

import gymnasium as gym
import minari
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import FrameStackObservation, RecordEpisodeStatistics, RescaleAction, TimeLimit
from gymnasium.wrappers.vector import RecordEpisodeStatistics as RecordVectorStatistics
from sb3_contrib import TQC
from stable_baselines3 import PPO, SAC, TD3

from agents import make_vec_env
from flatgym import Distribution, Hoop, Scenario, Tolerance


@pytest.fixture(autouse=True)
def one_thread():
    """Use one thread; for small networks a second one is slower."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def env():
    return gym.make("FlatQuad-v0", scenario="hoop")


def flown(env, actions):
    """Apply actions until the end of the episode; return the results of each step."""
    steps = []
    for action in actions:
        steps.append(env.step(action))
        if steps[-1][2] or steps[-1][3]:
            break
    return steps


def random_actions(generator, *shape):
    return generator.uniform(-1, 1, (*shape, 2)).astype(np.float32)


def vectorised(num_envs, **arguments):
    """Return the batched environment from `gym.make_vec`."""
    return gym.make_vec("FlatQuad-v0", num_envs=num_envs, vectorization_mode="vector_entry_point", **arguments)


class TestWrappers:
    def test_episode_statistics_are_those_of_the_flight(self, env, generator):
        recorded = RecordEpisodeStatistics(env)
        recorded.reset(seed=0)
        steps = flown(recorded, random_actions(generator, 300))
        episode, info = steps[-1][4]["episode"], steps[-1][4]
        assert episode["l"] == len(steps) == info["steps"]
        assert episode["r"] == pytest.approx(sum(step[1] for step in steps))
        assert list(recorded.length_queue) == [len(steps)]

    def test_a_time_limit_of_ones_own_truncates(self, env):
        limited = TimeLimit(env, max_episode_steps=7)
        hover = env.unwrapped.scenario.quadrotor.action([9.81, 0.0]).astype(np.float32)
        limited.reset(seed=0)
        steps = flown(limited, [hover] * 20)
        assert len(steps) == 7
        assert [step[3] for step in steps] == [False] * 6 + [True]
        assert not any(step[2] for step in steps)
        assert steps[-1][4]["outcome"] == "flying"

    def test_max_episode_steps_of_make_truncates(self):
        limited = gym.make("FlatQuad-v0", max_episode_steps=5)
        limited.reset(seed=0)
        assert len(flown(limited, np.zeros((20, 2), np.float32))) == 5

    def test_stacked_frames_are_the_last_observations_in_order(self, env, generator):
        stacked, plain = FrameStackObservation(env, 4), gym.make("FlatQuad-v0", scenario="hoop")
        stack, first = stacked.reset(seed=3)[0], plain.reset(seed=3)[0]
        frames = [first] * 4
        assert stack.shape == stacked.observation_space.shape == (4, *plain.observation_space.shape)
        np.testing.assert_array_equal(stack, frames)
        for action in random_actions(generator, 6):
            frames = [*frames[1:], plain.step(action)[0]]
            stack = stacked.step(action)[0]
            np.testing.assert_array_equal(stack, frames)
            assert stack in stacked.observation_space

    def test_rescaled_actions_fly_the_same_flight(self, env, generator):
        rescaled, plain = RescaleAction(env, np.float32(0), np.float32(1)), gym.make("FlatQuad-v0", scenario="hoop")
        rescaled.reset(seed=0)
        plain.reset(seed=0)
        shares = generator.uniform(0, 1, (30, 2)).astype(np.float32)
        for share in shares:
            ours, its = rescaled.step(share), plain.step(2 * share - 1)
            np.testing.assert_allclose(ours[4]["state"], its[4]["state"], atol=1e-5)
            assert ours[2:4] == its[2:4]


class TestVectorStatistics:
    @pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
    def test_they_are_those_of_the_flights(self, mode, generator):
        envs = RecordVectorStatistics(vectorised(6, autoreset_mode=mode))
        envs.reset(seed=0)
        returns, ends = np.zeros(6), 0
        for actions in np.repeat(random_actions(generator, 40, 6), 10, axis=0):  # held, so episodes differ in length
            _, rewards, terminated, truncated, infos = envs.step(actions)
            returns += rewards  # the reward of a reset step is zero
            for i in np.flatnonzero(terminated | truncated):
                final = infos["final_info"] if mode == AutoresetMode.SAME_STEP else infos
                assert infos["_episode"][i]
                assert infos["episode"]["l"][i] == final["steps"][i]
                assert infos["episode"]["r"][i] == pytest.approx(returns[i])
                returns[i], ends = 0.0, ends + 1
        assert ends == envs.episode_count == len(envs.return_queue) >= 12

    def test_some_flights_are_reset_by_a_mask(self):
        envs = RecordVectorStatistics(vectorised(3, autoreset_mode=AutoresetMode.DISABLED))
        envs.reset(seed=0)
        envs.step(np.zeros((3, 2), np.float32))
        mask = np.array([True, False, True])
        _, infos = envs.reset(options={"reset_mask": mask})
        np.testing.assert_array_equal(infos["steps"], [0, 1, 0])
        np.testing.assert_array_equal(envs.episode_lengths, [0, 1, 0])


OFF_POLICY = {"learning_starts": 100, "train_freq": 8, "gradient_steps": 4, "batch_size": 32, "buffer_size": 1000}
LEARNERS = {
    "PPO": (PPO, {"n_steps": 64, "batch_size": 32, "n_epochs": 2}),
    "SAC": (SAC, OFF_POLICY),
    "TD3": (TD3, OFF_POLICY),
    "TQC": (TQC, OFF_POLICY),
}


class TestLearners:
    @pytest.mark.parametrize("name", LEARNERS)
    def test_they_learn_on_one_vehicle(self, name, env, tmp_path):
        learner, settings = LEARNERS[name]
        self.learn_save_load(learner("MlpPolicy", env, seed=0, device="cpu", **settings), tmp_path, 320)

    @pytest.mark.parametrize("name", ["PPO", "SAC"])
    def test_they_learn_on_many_vehicles(self, name, tmp_path):
        learner, settings = LEARNERS[name]
        envs = make_vec_env("hoop", 8, seed=0)
        self.learn_save_load(learner("MlpPolicy", envs, seed=0, device="cpu", **settings), tmp_path, 1024)

    def learn_save_load(self, model, folder, steps):
        """Learn; the network must have changed, and act from the file as it did before it was saved."""
        before = [parameter.clone() for parameter in model.policy.parameters()]
        model.learn(steps)
        assert model.num_timesteps >= steps
        assert any(not torch.equal(old, new) for old, new in zip(before, model.policy.parameters(), strict=True))
        model.save(folder / "model.zip")
        again = type(model).load(folder / "model.zip", device="cpu")
        observations = np.stack([model.observation_space.sample() for _ in range(16)])
        actions = model.predict(observations, deterministic=True)[0]
        assert np.isfinite(actions).all()
        np.testing.assert_array_equal(actions, again.predict(observations, deterministic=True)[0])


class Agent(torch.nn.Module):
    """A small actor and critic in the style of CleanRL."""

    def __init__(self, envs):
        super().__init__()
        observed, acted = (space.shape[0] for space in (envs.single_observation_space, envs.single_action_space))
        self.body = torch.nn.Sequential(torch.nn.Linear(observed, 32), torch.nn.Tanh())
        self.mean, self.critic = torch.nn.Linear(32, acted), torch.nn.Linear(32, 1)
        self.log_std = torch.nn.Parameter(torch.zeros(acted))

    def forward(self, observations):
        hidden = self.body(observations)
        return torch.distributions.Normal(self.mean(hidden), self.log_std.exp()), self.critic(hidden).squeeze(-1)


def rollout(envs, agent, steps):
    """Roll out as CleanRL does; `done` before a step marks a reset step. Bootstraps at truncation."""
    observations, dones = [envs.reset(seed=0)[0]], [np.zeros(envs.num_envs, bool)]
    actions, rewards, terminations = [], [], []
    for _ in range(steps):
        with torch.no_grad():
            action = agent(torch.as_tensor(observations[-1]))[0].sample().clamp(-1, 1)
        observation, reward, terminated, truncated, _ = envs.step(action.numpy())
        for column, value in zip(
            (observations, actions, rewards, terminations, dones),
            (observation, action.numpy(), reward, terminated, terminated | truncated),
            strict=True,
        ):
            column.append(value)
    return [torch.as_tensor(np.array(column)) for column in (observations, actions, rewards, terminations, dones)]


def advantages(rewards, values, terminations, dones, discount=0.99, decay=0.95):
    """Generalised advantages under NEXT_STEP autoreset; the caller masks those of reset steps."""
    result, last = torch.zeros_like(rewards), torch.zeros_like(rewards[0])
    for t in reversed(range(len(rewards))):
        error = rewards[t] + discount * values[t + 1] * ~terminations[t] - values[t]
        last = result[t] = error + discount * decay * last * ~dones[t + 1]
    return result


class TestCleanRLLoop:
    @pytest.fixture
    def envs(self):
        return vectorised(8)

    @pytest.fixture
    def agent(self, envs):
        torch.manual_seed(0)
        return Agent(envs)

    @pytest.fixture
    def flown(self, envs, agent):
        return rollout(envs, agent, 400)

    def test_the_step_after_the_end_only_resets(self, flown):
        observations, _, rewards, terminations, dones = flown
        resets = dones[:-1]
        assert resets.sum() >= 8
        assert not rewards[resets].any()
        assert not (terminations | dones[1:])[resets].any()
        assert (observations[1:][resets] == observations[0, 0]).all()  # named scenarios have a fixed start

    def test_advantages_are_those_of_the_flights_one_by_one(self, agent, flown):
        observations, _, rewards, terminations, dones = flown
        rewards = rewards.double()
        with torch.no_grad():
            values = agent(observations)[1].double()
        given = advantages(rewards, values, terminations, dones)
        checked = 0
        for i in range(rewards.shape[1]):
            ends = [-1, *(t for t in range(len(rewards)) if dones[t + 1, i])]
            for before, end in pairwise(ends):
                first = before + 2 if before >= 0 else 0  # the step in between is a reset
                expected = self.plain(
                    rewards[first : end + 1, i], values[first : end + 2, i], bool(terminations[end, i])
                )
                np.testing.assert_allclose(given[first : end + 1, i], expected, atol=1e-9)
                checked += 1
        assert checked >= 8

    def plain(self, rewards, values, terminated, discount=0.99, decay=0.95):
        """GAE of one flight by its definition: the decayed sum of temporal-difference errors."""
        following = values[1:].clone()
        if terminated:
            following[-1] = 0.0
        errors = rewards + discount * following - values[:-1]
        weights = (discount * decay) ** np.arange(len(errors))
        return [float((errors[t:] * torch.as_tensor(weights[: len(errors) - t])).sum()) for t in range(len(errors))]

    def test_an_update_on_the_masked_steps_lowers_its_loss(self, agent, flown):
        observations, actions, rewards, terminations, dones = flown
        with torch.no_grad():
            values = agent(observations)[1]
            old = agent(observations[:-1])[0].log_prob(actions).sum(-1)
        advantage = advantages(rewards.float(), values, terminations, dones)
        mask = ~dones[:-1]
        optimiser = torch.optim.Adam(agent.parameters(), 1e-3)
        losses = []
        for _ in range(10):
            policy, value = agent(observations[:-1][mask])
            gain = (policy.log_prob(actions[mask]).sum(-1) - old[mask]).exp()
            scaled = (advantage[mask] - advantage[mask].mean()) / advantage[mask].std()
            clipped = torch.minimum(gain * scaled, gain.clamp(0.8, 1.2) * scaled)
            loss = -clipped.mean() + 0.5 * (value - (advantage + values[:-1])[mask]).square().mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            losses.append(loss.item())
        assert losses[-1] < losses[0]


OWN = Scenario("own", (0, 0), (3, 1), (Hoop(1.5, 0.5, 1.0),), tolerance=Tolerance(0.2), dt=0.04)
TASKS = {"named": "hoop", "own": OWN, "distribution": Distribution("mine", hoops=(1, 2), least_distance=3.0)}


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("stored", ["now", "before"])
def test_minari_records_episodes_that_replay(task, stored, generator, tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    env = gym.make("FlatQuad-v0", scenario=TASKS[task])
    collector = minari.DataCollector(env)
    for seed in (1, 2):
        collector.reset(seed=seed)
        flown(collector, random_actions(generator, 300))
    dataset = collector.create_dataset(
        "flatquad/test/random-v0",
        eval_env=env.spec,
        algorithm_name="random",
        author="FlatQuad",
        author_email="",
        code_permalink="",
        description="Random flights.",
    )
    collector.close()
    if stored == "before" and task != "named":  # Gymnasium wrote a task as the dict of its fields
        (file,) = tmp_path.rglob("metadata.json")
        metadata = json.loads(file.read_text())
        spec = json.loads(metadata["env_spec"])
        spec["kwargs"]["scenario"] = asdict(TASKS[task])
        file.write_text(json.dumps(metadata | {"env_spec": json.dumps(spec | {"max_episode_steps": None})}))
    again = minari.load_dataset("flatquad/test/random-v0")
    assert again.total_episodes == dataset.total_episodes == 2
    replayed = again.recover_environment()
    assert replayed.unwrapped.fleet.config.problem == env.unwrapped.fleet.config.problem
    for seed, episode in zip((1, 2), again.iterate_episodes(), strict=True):
        first, _ = replayed.reset(seed=seed)
        steps = flown(replayed, episode.actions)
        np.testing.assert_array_equal(np.stack([first, *(step[0] for step in steps)]), episode.observations)
        np.testing.assert_array_equal([step[1] for step in steps], episode.rewards)
        assert steps[-1][2:4] == (episode.terminations[-1], episode.truncations[-1])
        assert episode.terminations[-1] or episode.truncations[-1]
