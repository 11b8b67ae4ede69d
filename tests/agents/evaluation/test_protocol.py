"""The protocol: how many episodes, and which seeds a training may have met."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from agents.evaluation.protocol import protocol_episodes, seed_warning
from agents.policies.spaces import Layout, Stacked
from flatgym import DISTRIBUTIONS, SCENARIOS, Disturbances
from flatgym.scenarios.reference import EVALUATION_SEED, drawn_k_star

WINDY = Disturbances(wind=0.5)


@dataclass
class Model:
    """What a loaded model of Stable-Baselines3 knows of its training."""

    seed: int | None = 0
    n_envs: int = 1


@pytest.mark.parametrize(
    ("problem", "episodes"), [("hoop", 1), ("random-goal", 1000), ("random-hoops", 300), ("random-track", 100)]
)
def test_the_number_of_episodes_is_that_of_the_page(problem, episodes):
    assert protocol_episodes(problem) == episodes
    assert protocol_episodes(problem, WINDY) == 200


def test_as_many_episodes_as_have_a_shipped_k_star():
    for name in DISTRIBUTIONS:
        count = protocol_episodes(name)
        known = drawn_k_star(name, EVALUATION_SEED + np.arange(count + 1)).k_star
        assert np.isfinite(known[:count]).all()
        assert np.isnan(known[count])


def test_tasks_of_ones_own_have_an_episode_or_a_hundred():
    assert protocol_episodes(replace(SCENARIOS["hoop"], name="mine", time_limit=7.0)) == 1
    assert protocol_episodes(replace(DISTRIBUTIONS["random-goal"], name="mine", half_width=2.0)) == 100


@pytest.mark.parametrize("seed", [0, 5, EVALUATION_SEED - 1])
def test_seeds_of_training_are_warned_of(seed):
    assert "for training, so the policy may know these episodes" in seed_warning(None, "random-goal", seed, 10)
    assert "for training" in seed_warning(None, "hoop", seed, 10, WINDY)
    assert seed_warning(None, "hoop", seed, 1) == ""


@pytest.mark.parametrize(
    ("own", "vehicles", "met"),
    [
        (0, 64, False),
        (EVALUATION_SEED - 1, 1, False),
        (EVALUATION_SEED - 1, 2, True),
        (EVALUATION_SEED + 9, 1, True),
        (EVALUATION_SEED + 10, 1, False),
        (None, 64, False),
    ],
)
def test_the_seed_of_a_zip_is_compared_with_the_scored_ones(own, vehicles, met):
    for policy in (Model(own, vehicles), Stacked(Model(own, vehicles), Layout(frames=2))):
        said = seed_warning(policy, "random-goal", EVALUATION_SEED, 10)
        assert bool(said) == met
        assert not met or f"choose --seed {own + vehicles}" in said
