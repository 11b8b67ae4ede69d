"""Validation: ranking, the target, and the curve that it extends."""

import numpy as np
import pytest

from agents.controllers.cascaded_pd import CascadedPD
from agents.controllers.trivial import Hover
from agents.evaluation.validation import Validation, best_of, rank
from flatgym.scenarios.reference import reference
from flatgym.task import initial
from flatgym.task.scene import Scene
from flatgym.task.shaping import remaining_path_length


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


class Replay:
    """Actions in their order, then full thrust."""

    def __init__(self, actions):
        self.actions, self.k = actions, -1

    def predict(self, *_, **__):
        self.k += 1
        return self.actions[self.k][None] if self.k < len(self.actions) else np.array([[1.0, 0.0]]), None


def test_flights_without_success_are_told_apart_by_their_hoops_and_the_way_left():
    best, curve = reference("slalom"), []
    for share in (0.3, 0.6, 1.0):
        Validation("slalom", curve=curve).run(Replay(best.actions[: int(share * best.k_star)]), 0, 0.0)
    assert [point["success_rate"] for point in curve] == [0.0, 0.0, 1.0]
    assert [point["hoops_passed"] for point in curve] == [1.0, 2.0, 3.0]
    left = [point["way_left"] for point in curve]
    assert left == sorted(left, reverse=True)
    assert left[0] < 12.8  # the whole way
    assert left[-1] == 0.0


def test_the_way_left_of_a_flight_that_stays_is_the_whole_way():
    validation = Validation("random-hoops", episodes=3)
    validation.run(Hover(), 0, 0.0)
    scene = Scene.of([validation.problem.scenario(validation.seed + i) for i in range(3)])
    whole = remaining_path_length(scene, initial(scene)).mean()
    assert validation.curve[0]["way_left"] == pytest.approx(whole, abs=0.01)


@pytest.mark.parametrize(("problem", "episodes"), [("hoop", 1), ("random-goal", 7)])
def test_a_scenario_needs_one_episode(problem, episodes):
    assert Validation(problem, episodes=7).episodes == episodes
