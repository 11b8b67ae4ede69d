"""Scores measure against K*; a flight faster than K* is an error, not a score."""

from dataclasses import replace

import numpy as np
import pytest

from agents.evaluate import COLUMNS, FasterThanOptimal, evaluate, fly
from flatgym import SCENARIOS, Disturbances
from optimal import fewest_steps


class Tape:
    """A policy that plays actions in order, the last one for ever."""

    def __init__(self, actions):
        self.actions, self.k = actions, 0

    def predict(self, observation, *, deterministic=False):
        assert deterministic
        action = self.actions[min(self.k, len(self.actions) - 1)]
        self.k += 1
        return np.tile(action, (len(observation), 1)), None


@pytest.fixture(scope="module")
def optimum():
    return fewest_steps("horizontal-3", windings=(0,))


def test_the_optimal_flight_scores_zero_gap(optimum):
    scores = evaluate(Tape(optimum.actions), "horizontal-3", episodes=3, optimum=optimum, agent="tape", command="test")
    assert list(scores.columns) == list(COLUMNS)
    row = scores.iloc[0]
    assert (row.steps, row.k_star, row.gap, row.success_rate) == (optimum.steps, optimum.steps, 0.0, 1.0)
    assert (row.agent, row.command, row.outcomes) == ("tape", "test", {"goal": 3})
    assert set(row.versions) >= {"python", "flatgym", "torch"}


def test_a_failing_policy_has_no_gap(optimum):
    row = evaluate(Tape(np.array([[1.0, 0.0]])), "horizontal-3", episodes=2, optimum=optimum).iloc[0]
    assert row.success_rate == 0
    assert np.isnan(row.steps)
    assert np.isnan(row.gap)
    assert row.outcomes == {"out-of-bounds": 2}


def test_faster_than_optimal_is_a_failure_with_evidence(optimum):
    wrong = replace(optimum, steps=optimum.steps + 1)
    with pytest.raises(FasterThanOptimal, match="K\\* is wrong") as failure:
        evaluate(Tape(optimum.actions), "horizontal-3", episodes=1, optimum=wrong)
    np.testing.assert_array_equal(failure.value.actions, optimum.actions)
    np.testing.assert_allclose(failure.value.states, optimum.states, atol=1e-12)


def test_flights_keep_their_states_and_actions(optimum):
    flights = fly(Tape(optimum.actions), SCENARIOS["horizontal-3"], episodes=2)
    assert flights.outcomes == ("goal", "goal")
    np.testing.assert_allclose(flights.states[1], optimum.states, atol=1e-12)


def test_bad_questions_are_refused(optimum):
    with pytest.raises(ValueError, match="episodes must be at least 1, got 0"):
        fly(Tape(optimum.actions), "horizontal-3", episodes=0)
    with pytest.raises(ValueError, match=r"unknown columns \['colour'\]"):
        evaluate(Tape(optimum.actions), "horizontal-3", optimum=optimum, colour="red")
    with pytest.raises(ValueError, match="must be finite"):
        fly(Tape(np.array([[np.nan, 0.0]])), "horizontal-3")
    with pytest.raises(ValueError, match=r"must have shape \(1, 2\)"):
        fly(Tape(np.array([[0.0, 0.0, 0.0]])), "horizontal-3")


def test_disturbed_scores_say_so_and_claim_nothing_against_k_star(optimum):
    hover = np.array([(9.81 - 10.5) / 9.5, 0.0])
    late = replace(optimum, steps=1000)
    calm, windy = (
        evaluate(Tape([hover]), "horizontal-3", 4, optimum=late, disturbances=disturbances).iloc[0]
        for disturbances in (Disturbances(), Disturbances(wind=3.0, sensor_noise=0.01))
    )
    assert (calm.disturbances, calm.outcomes) == ({}, {"time-limit": 4})
    assert windy.disturbances == {"wind": 3.0, "sensor_noise": 0.01}
    assert windy.outcomes != calm.outcomes
    # The same flight is an error in still air, and no news with a little noise in what is measured.
    with pytest.raises(FasterThanOptimal):
        evaluate(Tape(optimum.actions), "horizontal-3", optimum=late)
    row = evaluate(Tape(optimum.actions), "horizontal-3", 2, optimum=late, disturbances=Disturbances(sensor_noise=0.01))
    assert row.iloc[0].steps == optimum.steps
