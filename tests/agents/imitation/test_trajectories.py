"""Expert data along trajectories: time reversal, hoops passed, and plans after the last hoop."""

from dataclasses import replace

import numpy as np
import pytest

from agents.imitation.trajectories import hoops_passed_along, labels_along, plan_labels, time_reversed
from flatgym import SCENARIOS
from flatgym.scenarios.reference import ghost_states, reference
from flatgym.task.rollout import fly_actions


@pytest.mark.parametrize("name", ["climb", "hoop", "high-hoop", "loop"])
def test_a_flight_reversed_in_time_flies_from_the_goal_to_the_start(flight, name):
    known = reference(name)
    flown = {"states": ghost_states(name), "actions": known.actions, "winding": known.winding}
    flight = replace(flight, scenario=SCENARIOS[name], **flown)
    back = time_reversed(flight)
    flown = back.scenario.quadrotor.step(back.states[:-1], back.scenario.quadrotor.control(back.actions), 0.02)
    np.testing.assert_allclose(flown, back.states[1:], atol=1e-6)
    assert (back.scenario.start, back.scenario.goal) == (flight.scenario.goal, flight.scenario.start)
    np.testing.assert_allclose(back.states[-1, :4], [*flight.scenario.start, 0, 0])
    assert np.abs(back.states[0] - back.scenario.start_state).max() <= 0.2  # the tolerance
    assert hoops_passed_along(back.scenario, back.states, back.actions)[-1] == len(flight.scenario.hoops)
    again = time_reversed(back)
    np.testing.assert_allclose(again.states, flight.states, atol=1e-12)
    np.testing.assert_array_equal(again.actions, flight.actions)


@pytest.mark.parametrize("name", ["hoop", "loop"])
def test_hoops_are_counted_as_in_the_environment(name):
    flown = fly_actions(SCENARIOS[name], reference(name).actions)
    states = np.array([state.state[0] for state in flown])
    counted = hoops_passed_along(SCENARIOS[name], states, reference(name).actions)
    assert counted.tolist() == [state.hoops_passed[0] for state in flown]


def test_after_the_last_hoop_the_plan_from_an_optimal_flight_continues_it(sampled):
    for flight in sampled[1]:
        passed = hoops_passed_along(flight.scenario, flight.states, flight.actions)
        since = int(np.argmax(passed == len(flight.scenario.hoops)))
        plan = plan_labels(flight, flight.states, flight.actions, every=200, steps=100)
        # The tightened tolerance of the plan may cost one step.
        assert flight.steps - since - 1 <= plan.labels <= flight.steps - since + 1
        own = labels_along(flight.scenario, flight.states, flight.actions)
        np.testing.assert_allclose(plan.observations[0], own.observations[since], atol=1e-6)


def test_before_the_last_hoop_there_is_no_plan(sampled):
    flight = sampled[1][0]
    beside = flight.states[:20] + np.array([3.0, 3.0, 0.0, 0.0, 0.0])
    assert plan_labels(flight, beside, flight.actions[:19], every=5, steps=30).labels == 0
