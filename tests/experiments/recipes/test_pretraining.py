"""Training of the policies that come with the package: each has a card that states how it was trained."""

import json
from dataclasses import replace

import pytest

from agents import policies
from agents.evaluation.validation import milestones
from agents.imitation.dataset_aggregation import DaggerConfig
from agents.training.configs import PPOConfig
from experiments.recipes import pretraining
from experiments.recipes.reinforcement import ppo_config
from flatgym import DISTRIBUTIONS, SCENARIOS
from flatgym.scenarios import catalogue


@pytest.fixture
def brief(monkeypatch, tmp_path):
    stage = DaggerConfig(width=16, depth=1, gradient_steps=20, rounds=2)
    monkeypatch.setattr(pretraining, "STAGES", ((stage, 0.05), (replace(stage, gradient_steps=10), 0.02)))
    monkeypatch.setattr(pretraining, "STORE", tmp_path / "flights")
    monkeypatch.setattr(pretraining, "N_FLIGHTS", {"random-goal": 4})
    monkeypatch.setattr(pretraining, "protocol_episodes", lambda _: 3)
    small = replace(
        pretraining.DISTRIBUTION_CONFIGS["random-goal"],
        width=16,
        depth=1,
        gradient_steps=20,
        rounds=2,
        n_eval_episodes=4,
    )
    monkeypatch.setattr(pretraining, "DISTRIBUTION_CONFIGS", {"random-goal": small})
    return tmp_path


def test_a_policy_for_a_scenario_and_its_card(brief):
    card = pretraining.pretrain_scenario("horizontal-3", 3, brief, "the command")
    assert json.loads((brief / "horizontal-3.json").read_text()) == card
    assert (card["seed"], card["command"]) == (3, "the command")
    kinds = [config.pop("kind") for config in card["configs"]]
    assert kinds == ["DaggerConfig"] * 2
    assert [config["gradient_steps"] for config in card["configs"]] == [20, 10]
    assert len(card["curve"]) == 4
    assert DaggerConfig(**card["configs"][0]).seed == 3
    loaded = policies.load(brief / "horizontal-3.zip", trust=True)
    assert loaded.observation_space.shape == (19,)
    assert card["score"]["scenario"] == "horizontal-3"


def test_a_policy_for_a_distribution_and_its_card(brief):
    card = pretraining.pretrain_distribution("random-goal", 0, brief, "the command", jobs=1)
    assert json.loads((brief / "random-goal.json").read_text()) == card
    assert card["flights"] == 4
    assert card["score"]["episodes"] == 3
    assert len(list((brief / "flights").glob("*.json"))) == 4
    assert len(card["curve"]) == 2


def test_a_scenario_of_ones_own_has_a_policy_named_by_its_content(tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(pretraining, "pretrain_scenario", lambda *arguments: seen.append(arguments))
    monkeypatch.setattr(pretraining, "parallel_results", lambda calls, *_: (call[0](*call[1]) for call in calls))
    own = replace(SCENARIOS["hoop"], goal=(5.0, 4.0))
    assert list(pretraining.pretrain([own, "climb"], 3, tmp_path)) == [None, None]
    assert [catalogue.scenario(name) for name, *_ in seen] == [own, SCENARIOS["climb"]]
    assert [command for *_, command in seen] == [
        f"flatquad pretrain hoop-{own.digest[:8]} --seed 3",
        "flatquad pretrain climb --seed 3",
    ]


def test_a_distribution_without_dagger_is_trained_by_reward_and_resumes(tmp_path, monkeypatch):
    brief = {"env_steps": 256, "num_envs": 4, "batch_size": 64, "width": 16, "n_eval_episodes": 2}
    monkeypatch.setattr(pretraining, "TRAININGS", tmp_path / "trainings")
    monkeypatch.setattr(pretraining, "ppo_config", lambda spec: ppo_config(spec, **brief))
    monkeypatch.setattr(pretraining, "protocol_episodes", lambda _: 3)
    own = replace(DISTRIBUTIONS["random-goal"], half_width=4.0)
    name, seen = f"random-goal-{own.digest[:8]}", []
    (card,) = pretraining.pretrain([own], 2, tmp_path, seen.append)
    assert json.loads((tmp_path / f"{name}.json").read_text()) == card
    assert [(config["kind"], config["folder"], config["seed"]) for config in card["configs"]] == [
        ("PPOConfig", PPOConfig.folder, 2)
    ]
    assert (card["score"]["algorithm"], card["score"]["env_steps"], card["score"]["episodes"]) == ("PPO", 256, 3)
    assert card["curve"] == milestones(seen, success=1.0)
    assert policies.load(tmp_path / f"{name}.zip", trust=True).observation_space.shape == (19,)
    policy = (tmp_path / f"{name}.zip").read_bytes()
    (again,) = pretraining.pretrain([own], 2, tmp_path)
    assert again["score"]["env_steps"] == 256
    assert (tmp_path / f"{name}.zip").read_bytes() == policy, "a finished training is not repeated"
