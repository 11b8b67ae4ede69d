"""Training of the policies that come with the package: each has a card that states how it was trained."""

import json
from dataclasses import replace

import pytest

from agents import policies
from agents.imitation.dataset_aggregation import DaggerConfig
from experiments.recipes import pretraining
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


def test_a_distribution_without_a_configuration_is_refused_before_any_training(tmp_path):
    own = replace(DISTRIBUTIONS["random-goal"], half_width=4.0)
    with pytest.raises(ValueError, match=f"no configuration for the distribution random-goal-{own.digest[:8]}"):
        pretraining.pretrain([own, "hoop"], 0, tmp_path)
    assert list(tmp_path.iterdir()) == []
