"""The policies that come with the package are made by one command, whose card says what it did."""

import json
from dataclasses import replace

import pytest

from agents import policies
from agents.imitation.dataset_aggregation import DaggerConfig
from experiments.recipes import margins, pretraining
from flatgym import SCENARIOS
from flatgym.scenarios.reference import reference
from flatgym.task.rollout import fly_actions
from flatgym.task.scene import GOAL


@pytest.fixture
def brief(monkeypatch, tmp_path):
    stage = DaggerConfig(width=16, depth=1, gradient_steps=20, rounds=2)
    monkeypatch.setattr(pretraining, "STAGES", ((stage, 0.05), (replace(stage, gradient_steps=10), 0.02)))
    monkeypatch.setattr(pretraining, "STORE", tmp_path / "flights")
    monkeypatch.setattr(pretraining, "FLIGHTS", {"random-goal": 4})
    monkeypatch.setattr(pretraining, "EPISODES", {"random-goal": 3})
    small = replace(
        pretraining.GENERAL["random-goal"], width=16, depth=1, gradient_steps=20, rounds=2, n_eval_episodes=4
    )
    monkeypatch.setattr(pretraining, "GENERAL", {"random-goal": small})
    return tmp_path


def test_a_specialist_and_its_card(brief):
    made = pretraining.specialist("horizontal-3", 3, brief, "the command")
    assert json.loads((brief / "horizontal-3.json").read_text()) == made
    assert (made["seed"], made["command"]) == (3, "the command")
    kinds = [config.pop("kind") for config in made["configs"]]
    assert kinds == ["DaggerConfig"] * 2
    assert [config["gradient_steps"] for config in made["configs"]] == [20, 10]
    assert len(made["curve"]) == 4
    assert DaggerConfig(**made["configs"][0]).seed == 3
    loaded = policies.load(brief / "horizontal-3.zip", trust=True)
    assert loaded.observation_space.shape == (19,)
    assert made["score"]["scenario"] == "horizontal-3"


def test_a_generalist_and_its_card(brief):
    made = pretraining.generalist("random-goal", 0, brief, "the command", jobs=1)
    assert json.loads((brief / "random-goal.json").read_text()) == made
    assert made["flights"] == 4
    assert made["score"]["episodes"] == 3
    assert len(list((brief / "flights").glob("*.json"))) == 4
    assert len(made["curve"]) == 2


@pytest.mark.parametrize("name", ["hoop", "high-hoop"])
def test_the_teacher_flies_k_star_clear_of_the_rims(name):
    flight, known = margins.teacher(SCENARIOS[name]), reference(name)
    assert flight.scenario == SCENARIOS[name]
    assert flight.steps == known.k_star
    clear = margins.narrowed(SCENARIOS[name], margins.MARGINS[name])
    for scenario in (SCENARIOS[name], clear):
        assert fly_actions(scenario, flight.actions)[-1].outcome[0] == GOAL
