"""The policies that come with the package: small, carded, and as good here as their cards say."""

import json

import pytest

from agents import evaluate, policies
from agents.imitation.dataset_aggregation import DaggerConfig
from agents.policies import archive
from flatgym import DISTRIBUTIONS, SCENARIOS

NAMES = policies.names()
FLIGHTS = {"random-goal": 1000, "random-hoops": 300}


def card(name):
    return json.loads((archive.PRETRAINED / f"{name}.json").read_text(encoding="utf-8"))


def test_there_is_a_policy_for_everything_that_has_a_name():
    assert set(NAMES) == {*SCENARIOS, *DISTRIBUTIONS}


@pytest.mark.parametrize("name", NAMES)
def test_a_policy_scores_what_its_card_says(name):
    told = card(name)["score"]
    assert told["scenario"] == name
    row = evaluate(policies.pretrained(name), name, FLIGHTS.get(name, 1)).iloc[0]
    assert row.success_rate == pytest.approx(told["success_rate"], abs=0.005)
    assert row.steps == pytest.approx(told["steps"], rel=0.005)
    assert row.k_star == pytest.approx(told["k_star"], rel=0.005)


@pytest.mark.parametrize("name", NAMES)
def test_a_policy_is_small_and_its_card_says_how_it_was_made(name):
    assert (archive.PRETRAINED / f"{name}.zip").stat().st_size < 300_000
    made = card(name)
    assert made["command"] == f"python -m experiments.recipes.pretraining {name} --seed {made['seed']}"
    assert made["score"]["wall_time_s"] > 0
    assert made["curve"]
    first = dict(made["configs"][0])
    assert first.pop("kind") == "DaggerConfig"
    assert DaggerConfig(**first).scenario == name
    assert set(made["versions"]) >= {"python", "flatgym", "torch", "stable-baselines3"}
