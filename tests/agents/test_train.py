"""Training: reproducible, stops when told, keeps the best policy, and its files load."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from agents.configs import PPOConfig
from agents.evaluate import fly
from agents.train import GentleFailure, Schedules, build, load, read_curve, train
from agents.vec_env import make_vec_env
from optimal import fewest_steps

SMALL = PPOConfig(
    scenario="horizontal-3", env_steps=2048, num_envs=16, rollout=16, batch=128, epochs=2, width=16, check_every=2
)


@pytest.fixture
def small(tmp_path):
    return replace(SMALL, folder=str(tmp_path))


def test_same_seed_same_policy_and_files_that_load(small, tmp_path):
    first = train(small)
    assert first.env_steps == 2048
    assert [point["env_steps"] for point in first.curve] == [512, 1024, 1536, 2048, 2048]
    assert read_curve(small) == first.curve
    assert json.loads((tmp_path / "config.json").read_text())["seed"] == small.seed
    again = train(replace(small, folder=str(tmp_path / "again")))
    flights = [fly(load(training.model), small.scenario) for training in (first, again)]
    np.testing.assert_array_equal(flights[0].actions[0], flights[1].actions[0])
    other = train(replace(small, folder=str(tmp_path / "other"), seed=1))
    assert not np.array_equal(fly(load(other.model), small.scenario).actions[0][:5], flights[0].actions[0][:5])


def test_it_stops_by_the_clock(small):
    training = train(replace(small, env_steps=10**9, seconds=1.0))
    assert training.wall_time_s < 10
    assert training.model.exists()


def test_it_stops_at_the_optimum(small, monkeypatch):
    optimum = fewest_steps("horizontal-3", windings=(0,))
    # `agents.train` is the function; its module is found by name.
    module = sys.modules[train.__module__]
    monkeypatch.setattr(module, "fly", lambda *_: fly(Tape(optimum.actions), "horizontal-3"))
    training = train(replace(small, env_steps=10**9), optimum)
    assert training.env_steps < 1024
    assert training.curve[-1]["steps"] == optimum.steps


class Tape:
    def __init__(self, actions):
        self.actions, self.k = actions, -1

    def predict(self, _, *, deterministic):
        self.k += 1
        return self.actions[self.k : self.k + 1], deterministic


def test_the_price_of_failure_is_fixed():
    envs = GentleFailure(make_vec_env("horizontal-3", 4), 0.5)
    envs.reset()
    ended = []
    for _ in range(250):
        _, rewards, dones, infos = envs.step(np.tile(np.array([1.0, 0.05], np.float32), (4, 1)))
        ended += [(info["outcome"], reward) for info, reward, done in zip(infos, rewards, dones, strict=True) if done]
    assert {"out-of-bounds"} == {outcome for outcome, _ in ended}
    assert {-0.5} == {float(reward) for _, reward in ended}


def test_the_tolerance_tightens_to_the_true_one(small):
    model = build(small)
    envs = model.get_env()
    seen = []

    class Watch(Schedules):
        def _on_rollout_end(self):
            super()._on_rollout_end()
            seen.append(envs.get_attr("scenario")[0].tolerance.position)

    model.learn(2048, callback=Watch(small, -np.inf))
    assert seen == sorted(seen, reverse=True)
    assert 0.2 < seen[0] < 0.3
    assert seen[-1] == 0.1
    assert envs.get_attr("fleet")[0].share == pytest.approx(small.drawn_end)


def test_an_untouched_run_has_no_curve(tmp_path):
    assert read_curve(replace(SMALL, folder=str(tmp_path / "nowhere"))) == []
