"""Training: reproducibility, stopping, the best policy, initial policies, and files."""

import csv
import json
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch

from agents import policies
from agents.evaluation.rollouts import fly
from agents.policies import archive
from agents.training.callbacks import PPOCallback, TrainingCallback
from agents.training.configs import CONFIGS, PPOConfig, SACConfig, config_of
from agents.training.models import build
from agents.training.progress import read_curve
from agents.training.train import train
from flatgym.scenarios.reference import reference

load = partial(policies.load, trust=True)
SEEN = np.zeros((500, 19), np.float32)
SMALL = PPOConfig(
    scenario="horizontal-3", env_steps=2048, num_envs=16, n_steps=16, batch_size=128, n_epochs=2, width=16, eval_every=2
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
    assert again.model.read_bytes() == first.model.read_bytes()
    other = train(replace(small, folder=str(tmp_path / "other"), seed=1))
    flights = [fly(load(training.model), small.scenario) for training in (first, other)]
    assert not np.array_equal(flights[0].actions[0][:5], flights[1].actions[0][:5])


@pytest.mark.parametrize("algorithm", CONFIGS)
def test_every_algorithm_learns_on_distributions(tmp_path, algorithm):
    own = (
        {"n_steps": 8, "batch_size": 64}
        if algorithm == "PPO"
        else {"learning_starts": 64, "batch_size": 16, "buffer_size": 500}
    )
    config = config_of(
        algorithm, scenario="random-goal", env_steps=256, num_envs=8, n_eval_episodes=3, folder=str(tmp_path), **own
    )
    before = build(config).policy.state_dict()
    training = train(config)
    policy = load(training.model)
    assert type(policy).__name__ == algorithm
    assert any(not torch.equal(value, before[name]) for name, value in policy.policy.state_dict().items())
    assert all(point["success_rate"] in (0, 1 / 3, 2 / 3, 1) for point in training.curve)
    assert len(fly(policy, "random-goal", 2).steps) == 2


def test_width_and_depth_are_those_of_the_configuration(small):
    policy = build(replace(small, depth=3, value_width=32)).policy
    assert [layer.out_features for layer in policy.mlp_extractor.policy_net[::2]] == [16, 16, 16]
    assert [layer.out_features for layer in policy.mlp_extractor.value_net[::2]] == [32, 32, 32]


def test_it_stops_at_the_time_limit(small):
    training = train(replace(small, env_steps=10**9, max_seconds=1.0))
    assert training.wall_time_s < 10
    assert training.model.exists()


def test_it_stops_at_the_optimum(small, monkeypatch):
    known = reference("horizontal-3")
    monkeypatch.setattr("agents.evaluation.validation.fly", lambda *_: fly(OpenLoop(known.actions), "horizontal-3"))
    training = train(replace(small, env_steps=10**9), known.k_star)
    assert training.env_steps < 1024
    assert training.best["steps"] == known.k_star
    assert training.best["success_rate"] == 1


class OpenLoop:
    def __init__(self, actions):
        self.actions, self.k = actions, -1

    def predict(self, *_, **__):
        self.k += 1
        return self.actions[self.k : self.k + 1], None


def test_the_best_policy_is_stored_not_the_last(small, monkeypatch):
    known, models = reference("horizontal-3"), []

    def second_is_best(model, *_):
        models.append({name: value.clone() for name, value in model.policy.state_dict().items()})
        policy = OpenLoop(known.actions if len(models) == 2 else np.zeros((250, 2), np.float32))
        return fly(policy, "horizontal-3")

    monkeypatch.setattr("agents.evaluation.validation.fly", second_is_best)
    training = train(small)
    assert training.best is training.curve[1]
    kept = load(training.model).policy.state_dict()
    assert all(torch.equal(value, models[1][name]) for name, value in kept.items())
    assert not all(torch.equal(value, models[-1][name]) for name, value in kept.items())


def test_stable_baselines3_logs_each_session_as_csv(small, tmp_path):
    train(small)
    with (tmp_path / "logs" / "from-0" / "progress.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["time/total_timesteps"]) for row in rows] == list(range(256, 2049, 256))


def test_tensorboard_files_of_several_trainings_stand_in_one_folder(small, tmp_path):
    for seed in (0, 1):
        folder = str(tmp_path / f"seed-{seed}")
        train(replace(small, env_steps=256, seed=seed, folder=folder, tensorboard=str(tmp_path / "curves")))
    files = sorted((tmp_path / "curves").glob("*/events.out.tfevents*"))
    assert [file.parent.name for file in files] == ["seed-0", "seed-1"]
    assert all(b"time/fps" in file.read_bytes() for file in files)


def test_a_missing_tensorboard_is_named_before_training(small, monkeypatch):
    monkeypatch.setattr("flatgym.extras.find_spec", lambda _: None)
    with pytest.raises(ImportError, match=r"tensorboard not installed; run: pip install 'flatgym\[tensorboard\]'"):
        train(replace(small, tensorboard="runs"))


def test_the_curriculum_follows_the_environment_steps(small):
    model, seen = build(small), []
    envs = model.get_env()

    class Watch(PPOCallback):
        def apply_curriculum(self):
            super().apply_curriculum()
            seen.append((envs.get_attr("scenario")[0].tolerance.position, model.gamma, model.rollout_buffer.gamma))

    module = sys.modules[train.__module__]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("agents.training.callbacks.CURRICULUM_STEPS", 256)
        patch.setattr(module, "PPOCallback", Watch)
        patch.setattr(module, "build", lambda _: model)
        train(small)
    tolerance, discount, buffer = zip(*seen, strict=True)
    assert list(tolerance) == sorted(tolerance, reverse=True)
    assert list(discount) == sorted(discount)
    assert discount == buffer
    assert (tolerance[0], tolerance[-1]) == pytest.approx((0.3, 0.1))
    assert (discount[0], discount[-1]) == pytest.approx((small.gamma, small.gamma_end))
    assert envs.get_attr("fleet")[0].share == pytest.approx(small.pool_share_end)


@pytest.mark.parametrize("algorithm", [name for name in CONFIGS if name != "PPO"])
def test_n_step_returns_have_the_discount_of_the_model(algorithm):
    config = config_of(algorithm, scenario="horizontal-3", num_envs=2, buffer_size=20, n_steps=3)
    callback = TrainingCallback(config)
    callback.init_callback(build(config))
    callback.set_gamma(0.9)
    assert callback.model.gamma == callback.model.replay_buffer.gamma == 0.9
    assert callback.model.replay_buffer.n_steps == 3


@pytest.mark.parametrize("algorithm", ["SAC", "TQC", "CrossQ"])
def test_exploration_begins_small(algorithm):
    spread = [build_small(algorithm, log_std_init=value).predict(SEEN)[0].std(axis=0).mean() for value in (-1.0, -3.0)]
    assert spread[0] == pytest.approx(np.tanh(np.exp(-1.0)), rel=0.3)
    assert spread[1] == pytest.approx(np.exp(-3.0), rel=0.3)


def build_small(algorithm, **values):
    return build(config_of(algorithm, scenario="horizontal-3", num_envs=2, buffer_size=20, **values))


@pytest.fixture
def clone(tmp_path):
    """A policy to start from, with another network than the configuration."""
    return policies.save(
        build(replace(SMALL, width=24, depth=1, observation_scale=2.0, seed=5)), tmp_path / "clone.zip"
    )


def test_training_starts_with_the_weights_of_the_policy(small, clone):
    model = build(replace(small, policy=str(clone), log_std_init=-2.0))
    start = load(clone).policy.state_dict()
    for name, value in model.policy.state_dict().items():
        assert torch.equal(value, torch.full((2,), -2.0) if name == "log_std" else start[name])


@pytest.mark.parametrize(("warmup", "learns"), [(100, False), (3, True)])
def test_during_warmup_only_the_critic_learns(small, clone, monkeypatch, warmup, learns):
    config = replace(small, policy=str(clone), value_warmup=warmup)
    before, models = load(clone).policy.state_dict(), []
    monkeypatch.setattr(sys.modules[train.__module__], "build", _keep(build, models))
    training = train(config)
    after = models[0].policy.state_dict()
    changed = {name for name, value in after.items() if not torch.equal(value, before[name]) and name != "log_std"}
    assert {name for name in changed if "value" in name}
    assert {name for name in changed if "value" not in name} == (set(_actor(before)) if learns else set())
    assert training.curve[0]["env_steps"] == 0


def _actor(parameters):
    return [name for name in parameters if name.startswith(("mlp_extractor.policy_net", "action_net"))]


def _keep(function, results):
    def keeping(*arguments):
        results.append(function(*arguments))
        return results[-1]

    return keeping


def test_an_unsuitable_initial_policy_is_named(small, clone):
    with pytest.raises(ValueError, match=r"PPOConfig.policy must be a file or one of the pretrained .*'nowhere.zip'"):
        build(replace(small, policy="nowhere.zip"))
    with pytest.raises(ValueError, match=r"clone.zip is a policy of PPO; SAC cannot start from it"):
        build(SACConfig(scenario="horizontal-3", num_envs=2, buffer_size=10, policy=str(clone)))


def test_a_pretrained_policy_is_an_initial_policy_by_name(small, clone, monkeypatch):
    monkeypatch.setattr(archive, "PRETRAINED", clone.parent)
    model = build(replace(small, policy="clone"))
    assert torch.equal(model.policy.action_net.weight, load(clone).policy.action_net.weight)


def test_a_new_run_has_no_curve(tmp_path):
    assert read_curve(replace(SMALL, folder=str(tmp_path / "nowhere"))) == []
