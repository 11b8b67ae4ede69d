"""Recipes of PPO: the budget and the features follow the hoops of the task, and the turns follow the known flights."""

import numpy as np
import pytest

from experiments.recipes import reinforcement
from experiments.recipes.reinforcement import TUNED, TURNING, train_ppo
from experiments.recipes.run_spec import FULL, RunSpec
from flatgym import DISTRIBUTIONS, SCENARIOS, reference
from flatgym.task.rollout import fly_actions


@pytest.fixture
def recipe(monkeypatch, tmp_path):
    """The configuration with which a task is trained."""
    monkeypatch.setattr(reinforcement, "train_or_resume", lambda _, config: config)
    return lambda name, **values: train_ppo(RunSpec(name, 0, tmp_path), **values)


@pytest.mark.parametrize("name", [*SCENARIOS, *DISTRIBUTIONS])
def test_budget_and_features_follow_the_number_of_hoops(recipe, name):
    config, drawn = recipe(name), name in DISTRIBUTIONS
    hoops = max(DISTRIBUTIONS[name].hoops) if drawn else len(SCENARIOS[name].hoops)
    several = hoops > 1
    assert config.env_steps == FULL.ppo_steps[2 * drawn + several]
    assert config.max_seconds == FULL.ppo_s[2 * drawn + several]
    assert config.guidance == TUNED.get(name, {}).get("guidance", several or drawn)
    assert (config.width > 64) == drawn


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_turns_are_those_of_the_best_known_flight(recipe, name):
    config = recipe(name)
    tilt = fly_actions(SCENARIOS[name], reference(name).actions)[-1].state[0, 4]
    assert (config.turns or 0) == np.round(tilt / (2 * np.pi))
    assert "turns" in TUNED.get(name, {}) or config.failure_cost != TURNING["failure_cost"]


def test_values_replace_those_of_the_recipe(recipe):
    assert recipe("slalom", turns=None, guidance=False).turns is None
    assert recipe("slalom", guidance=False).guidance is False
