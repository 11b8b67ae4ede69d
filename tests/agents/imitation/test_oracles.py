"""Expert oracles: labels of the LQR, fallback for lost episodes, and the combined oracle of a distribution."""

import numpy as np
import pytest

from agents.controllers.cascaded_pd import CascadedPD
from agents.controllers.tracking import Expert
from agents.evaluation.rollouts import fly
from agents.imitation.cloning import CloneConfig, clone
from agents.imitation.oracles import combined_oracle, lqr_oracle
from agents.imitation.trajectories import time_reversed
from flatgym import SCENARIOS
from flatgym.scenarios.reference import reference
from optimal import fewest_steps

BRAKE = (-0.25, 0.125)
"""An action that no expert takes."""


class Constant:
    """A policy that always returns the same action."""

    def __init__(self, thrust, rate):
        self.action = np.array([thrust, rate], dtype=np.float32)

    def predict(self, observations, **_):
        return np.broadcast_to(self.action, (len(observations), 2)), None


class GoalTooHigh:
    """A policy that takes the goal to be 30 cm higher than it is, and hovers there."""

    def __init__(self, policy):
        self.policy = policy

    def predict(self, observations, **_):
        return self.policy.predict(observations + 0.15 * np.eye(19, dtype=np.float32)[1])


def test_labels_are_the_actions_of_the_expert_and_reproducible(flight, data):
    expert = Expert(flight)
    np.testing.assert_allclose(expert.predict(data.observations)[0], data.actions, atol=2e-3)
    again = lqr_oracle([flight], count=8)(None, 0)
    np.testing.assert_array_equal(again.observations, data.observations)


def test_the_first_episode_is_unperturbed(flight):
    alone = lqr_oracle([flight], count=1)(None, 0)
    assert len(alone.actions) == flight.steps


def test_a_lost_episode_ends_or_is_labelled_by_the_fallback(flight):
    climbing = Constant(1.0, 0.0)
    ended = lqr_oracle([flight], count=1)(climbing, 1)
    assert 0 < ended.env_steps == ended.labels == len(ended.actions) < flight.steps
    rescued = lqr_oracle([flight], count=1, fallback=Constant(*BRAKE))(climbing, 1)
    np.testing.assert_array_equal(rescued.actions[: ended.labels], ended.actions)
    assert rescued.env_steps > ended.env_steps
    assert (rescued.actions[ended.labels :] == BRAKE).all()
    assert rescued.labels == rescued.env_steps


def test_after_a_missed_hoop_the_fallback_labels_until_it_is_passed():
    scenario = SCENARIOS["high-hoop"]
    flight = fewest_steps("high-hoop", windings=(reference("high-hoop").winding,), time_budget=0.0)
    straight = fewest_steps("diagonal", windings=(0,), time_budget=0.0)  # to the same goal, not through the hoop
    assert straight.scenario.goal == scenario.goal
    policy = Expert(straight)
    ended = lqr_oracle([flight], count=1)(policy, 1)
    rescued = lqr_oracle([flight], count=1, fallback=Constant(*BRAKE))(policy, 1)
    assert len(ended.actions) < len(rescued.actions)
    assert (rescued.actions[-20:] == BRAKE).all()


def test_hovering_at_the_goal_is_labelled_at_a_stride(flight):
    without_lag = lqr_oracle([flight], count=3, start_noise=0.0, action_noise=0.0)(None, 0)
    assert len(without_lag.actions) == 3 * flight.steps
    quiet = lqr_oracle([flight, flight], count=2, start_noise=0.0, action_noise=0.0)
    ended = quiet(Expert(flight, max_lag=1), 1)
    assert ended.env_steps == ended.labels == 2 * flight.steps
    hovering = lqr_oracle([flight], count=1)(GoalTooHigh(Expert(flight, max_lag=1)), 1)
    assert hovering.env_steps == flight.scenario.max_steps
    assert hovering.labels == flight.steps + len(range(flight.steps + (-flight.steps) % 3, hovering.env_steps, 3))


def test_states_after_the_last_hoop_may_stay_unlabelled(flight):
    oracle = lqr_oracle([flight], count=1, after_last_hoop=False)
    assert oracle(None, 0).labels == flight.steps
    assert oracle(Expert(flight, max_lag=1), 1).labels == 0  # the scenario has no hoop


@pytest.fixture(scope="module")
def combined(sampled):
    distribution, flights = sampled
    counts = {"count": 6, "plan_episodes": 2, "plan_every": 20, "plan_steps": 5, "plan_weight": 2}
    return combined_oracle(flights, distribution, **counts, jobs=1)


def test_combined_labels_come_in_mirrored_pairs_with_their_counts(sampled, combined):
    distribution, flights = sampled
    own = combined(None, 0)
    assert own.env_steps == 0
    assert len(own.actions) == 2 * own.labels >= 2 * flights[0].steps
    model = clone(
        own, CloneConfig(scenario="random-hoops", width=32, depth=2, batch_size=128, gradient_steps=100, guidance=True)
    )
    data = combined(model, 1)
    half = len(data.actions) // 2
    np.testing.assert_array_equal(data.actions[:half, 0], data.actions[half:, 0])
    np.testing.assert_array_equal(data.actions[:half, 1], -data.actions[half:, 1])
    again = combined(model, 1)
    np.testing.assert_array_equal(again.observations, data.observations)
    lqr = lqr_oracle(
        [*flights, *map(time_reversed, flights)],
        count=6,
        start_noise=0.3,
        window=range(-6, 4),
        fallback=CascadedPD(),
        after_last_hoop=False,
    )
    assert data.env_steps == lqr(model, 1).env_steps + fly(model, distribution, 2, 0).steps.sum()
    assert half >= data.labels > 0
