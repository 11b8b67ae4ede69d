"""The pretrained policies: small files, and cards that state score, command, configuration and commit."""

import json
import re

import pytest

from agents import evaluate, policies
from agents.imitation.dataset_aggregation import DaggerConfig
from agents.policies import archive
from agents.training.configs import PPOConfig
from experiments.publishing.policies import current_configs, same_recipe
from flatgym import DISTRIBUTIONS, SCENARIOS

NAMES = policies.names()
KINDS = {kind.__name__: kind for kind in (DaggerConfig, PPOConfig)}
EPISODES = {"random-goal": 1000, "random-hoops": 300, "random-track": 100}


def card(name):
    return json.loads((archive.PRETRAINED / f"{name}.json").read_text(encoding="utf-8"))


def test_every_named_problem_has_a_policy():
    assert set(NAMES) == {*SCENARIOS, *DISTRIBUTIONS}


@pytest.mark.parametrize("name", NAMES)
def test_a_policy_has_the_score_of_its_card(name):
    score = card(name)["score"]
    assert score["scenario"] == name
    row = evaluate(policies.pretrained(name), name, EPISODES.get(name, 1)).iloc[0]
    assert row.success_rate == pytest.approx(score["success_rate"], abs=0.005)
    assert row.steps == pytest.approx(score["steps"], rel=0.005)
    assert row.k_star == pytest.approx(score["k_star"], rel=0.005)


@pytest.mark.parametrize("name", NAMES)
def test_a_policy_is_small_and_its_card_complete(name):
    assert (archive.PRETRAINED / f"{name}.zip").stat().st_size < 300_000
    made = card(name)
    assert made["command"] == f"flatquad pretrain {name} --seed {made['seed']}"
    assert made["score"]["wall_time_s"] > 0
    assert made["curve"]
    first = dict(made["configs"][0])
    assert KINDS[first.pop("kind")](**first).scenario == name
    assert set(made["versions"]) >= {"python", "flatgym", "torch", "stable-baselines3"}


@pytest.mark.parametrize("name", NAMES)
def test_a_card_names_the_commit_of_its_recipe(name):
    made = card(name)
    assert re.fullmatch(r"[0-9a-f]{40}\+?", made["commit"])
    if not same_recipe(made, current_configs(name, made)):  # today's command would train another policy
        assert not made["commit"].endswith("+")
