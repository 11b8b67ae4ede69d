"""Trajectories are consistent: derivatives, breakpoints, samples, shapes."""

import numpy as np
import pytest

from flatgym import SCENARIOS, Quadrotor
from optimal.direct.shooting import solve_winding
from optimal.flights.trajectory import Trajectory


@pytest.fixture(scope="module")
def flight():
    return solve_winding(SCENARIOS["horizontal-6"], nodes=40).trajectory


def test_it_starts_and_ends_at_rest(flight):
    np.testing.assert_allclose(flight.state(0.0), [0, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(flight.state(flight.duration), [6, 0, 0, 0, 0], atol=1e-8)


def test_each_order_is_the_derivative_of_the_previous_one(flight):
    middle = (flight.breakpoints[:-1] + flight.breakpoints[1:]) / 2
    h = 1e-6
    for order in range(3):
        slope = (flight(middle + h, order) - flight(middle - h, order)) / (2 * h)
        np.testing.assert_allclose(slope, flight(middle, order + 1), atol=1e-5)


def test_states_are_continuous_at_the_breakpoints(flight):
    before = flight.state(flight.breakpoints[1:-1] - 1e-12)
    np.testing.assert_allclose(before, flight.state(flight.breakpoints[1:-1]), atol=1e-8)


def test_samples_include_the_end(flight):
    samples = flight.sample(0.02)
    assert samples.time[0] == 0
    assert samples.time[-1] == flight.duration
    assert np.all(np.diff(samples.time) > 0)
    assert samples.state.shape == (len(samples.time), 5)
    np.testing.assert_array_equal(samples.control, flight.control(samples.time))
    np.testing.assert_allclose(flight.sample(flight.duration / 10).time, np.linspace(0, flight.duration, 11))


def test_shapes_follow_the_times():
    still = Trajectory(np.array([0, 1.0]), np.zeros((2, 5)), np.array([[9.81, 0.0]]), Quadrotor())
    for shape in ((), (3,), (2, 3)):
        assert still(np.full(shape, 0.5)).shape == (*shape, 2)
        assert still.state(np.full(shape, 0.5)).shape == (*shape, 5)


def test_invalid_arguments_are_rejected(flight):
    with pytest.raises(ValueError, match="order must be 0, 1, 2 or 3, got 4"):
        flight(0.0, order=4)
    with pytest.raises(ValueError, match="times must lie in"):
        flight.state(flight.duration + 0.1)
    with pytest.raises(ValueError, match="times must lie in"):
        flight.state(np.nan)
    with pytest.raises(ValueError, match="dt must be a positive number"):
        flight.sample(0.0)
