"""Validation: ranking, the target, and the curve that it extends."""

import pytest

from agents.controllers.cascaded_pd import CascadedPD
from agents.evaluation.validation import Validation, best_of, rank


def test_success_ranks_before_steps_and_the_first_of_equals_is_best():
    points = [{"success_rate": rate, "steps": steps} for rate, steps in ((0, 9), (0.5, 70), (1, 90), (1, 80), (1, 80))]
    assert sorted(points, key=rank) == points
    assert best_of(points) is points[3]
    assert best_of(points[:1]) is None


def test_only_a_better_policy_is_an_improvement():
    validation = Validation("horizontal-3")
    assert validation.run(CascadedPD(), env_steps=0, wall_time=0.0)
    assert not validation.run(CascadedPD(), env_steps=100, wall_time=1.26)
    first, second = validation.curve
    assert first["outcome"] == "goal"
    assert second == first | {"env_steps": 100, "wall_time_s": 1.3}


def test_the_target_is_reached_within_its_steps():
    validation = Validation("horizontal-3")
    validation.run(CascadedPD(), env_steps=0, wall_time=0.0)
    steps = validation.curve[0]["steps"]
    assert not validation.target_reached
    assert not Validation("horizontal-3", target=steps - 1, curve=validation.curve).target_reached
    assert Validation("horizontal-3", target=steps, curve=validation.curve).target_reached


@pytest.mark.parametrize(("problem", "episodes"), [("hoop", 1), ("random-goal", 7)])
def test_a_scenario_needs_one_episode(problem, episodes):
    assert Validation(problem, episodes=7).episodes == episodes
