"""Hover at the goal: the flight itself up to its duration, and the goal at rest for ever after."""

import numpy as np
import pytest

import optimal
from optimal import HoverAtGoal


@pytest.fixture(scope="module", params=["shooting", "flat", "pontryagin"])
def solution(request):
    return optimal.solve("climb" if request.param != "flat" else "horizontal-3", request.param, max_gap=None)


def test_within_its_duration_it_is_the_flight(solution):
    flight, t = solution.trajectory, np.linspace(0, solution.time, 50)
    held = HoverAtGoal(flight)
    np.testing.assert_array_equal(held.state(t), flight.state(t))
    np.testing.assert_array_equal(held.control(t), flight.control(t))
    for order in range(3):
        np.testing.assert_array_equal(held(t, order), flight(t, order))
    assert held.duration == flight.duration
    np.testing.assert_array_equal(held.sample(0.1).state, flight.sample(0.1).state)
    np.testing.assert_array_equal(held.breakpoints, flight.breakpoints)


def test_beyond_it_the_vehicle_rests_at_the_goal(solution):
    scenario, held = solution.scenario, HoverAtGoal(solution.trajectory)
    t = solution.time + np.array([[1e-9, 0.5], [3.0, 1e6]])
    goal = scenario.goal_state + 2 * np.pi * solution.winding * np.eye(5)[4]
    np.testing.assert_allclose(held.state(t), np.broadcast_to(goal, (2, 2, 5)), atol=1e-6)
    np.testing.assert_array_equal(held.state(t)[..., 2:4], 0)
    np.testing.assert_array_equal(held(t, 1), np.zeros((2, 2, 2)))
    rates = held.quadrotor.derivative(held.state(t), held.control(t))
    np.testing.assert_allclose(rates, 0, atol=1e-9)


def test_bad_times_raise(solution):
    held = HoverAtGoal(solution.trajectory)
    for wrong in (np.nan, np.inf):
        with pytest.raises(ValueError, match="times must be finite"):
            held.state(wrong)
    with pytest.raises(ValueError, match=r"from 0 to|in \[0"):
        held(-0.1)
    with pytest.raises(ValueError, match=r"from 0 to|in \[0"):
        solution.trajectory(solution.time + 0.1)
