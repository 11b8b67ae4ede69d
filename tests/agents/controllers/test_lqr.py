"""Time-varying LQR: exact derivatives, batched gains equal to single ones, optimality of the gain."""

from dataclasses import replace

import numpy as np
import pytest

from agents.controllers.lqr import derivatives, gain, terminal_cost, tolerances, tvlqr_gains
from agents.controllers.tracking import Expert, TrackingControllers, held, in_steps
from flatgym import SCENARIOS, Quadrotor
from flatgym.scenarios.reference import reference
from flatgym.scenarios.scenario import Tolerance
from optimal import fewest_steps

NAMES = ("climb", "hoop", "horizontal-3")


@pytest.fixture(scope="module")
def flights():
    return [fewest_steps(name, windings=(reference(name).winding,), time_budget=0.0) for name in NAMES]


def test_the_derivatives_are_those_of_the_step(generator):
    quadrotor = Quadrotor()
    states, controls = generator.normal(size=(4, 5, 5)), generator.normal([9.0, 0.0], size=(4, 5, 2))
    a, b = derivatives(quadrotor, states, controls, 0.02)
    push, turn = generator.normal(size=(4, 5, 5)) * 1e-4, generator.normal(size=(4, 5, 2)) * 1e-4
    change = quadrotor.step(states + push, controls + turn, 0.02) - quadrotor.step(states, controls, 0.02)
    linear = np.einsum("...ij,...j->...i", a, push) + np.einsum("...ij,...j->...i", b, turn)
    np.testing.assert_allclose(change, linear, atol=1e-8)


def test_batched_gains_equal_single_ones(flights):
    flown = [in_steps(flight) for flight in flights]
    longest = max(len(controls) for _, controls in flown)
    states, controls = (np.stack([held(one, longest) for one in ones]) for ones in zip(*flown, strict=True))
    last = np.array([len(controls) - 1 for _, controls in flown])
    together = tvlqr_gains(flights[0].scenario, states, controls, last)
    for gains, flight, (alone, commands) in zip(together, flights, flown, strict=True):
        single = tvlqr_gains(flight.scenario, alone, commands)
        expected = held(single, longest)  # up to finite-difference error
        np.testing.assert_allclose(gains, expected, rtol=1e-6, atol=1e-9)


def test_no_other_gain_costs_less_in_one_step(generator):
    """The gain minimises the trace of (A - B K)' P (A - B K) + K' R K."""
    a, b = derivatives(Quadrotor(), generator.normal(size=(1, 5)), np.array([[9.0, 0.3]]), 0.02)
    effort, cost = np.diag([0.01, 0.02]), terminal_cost(Tolerance())
    best = gain(a, b, effort, cost)[0]

    def price(gains):
        closed = a[0] - b[0] @ gains
        return np.trace(closed.T @ cost @ closed + gains.T @ effort @ gains)

    assert all(price(best) < price(best + 0.1 * generator.normal(size=(2, 5))) for _ in range(20))


def test_tracking_controllers_equal_single_experts_without_lag(flights, generator):
    together, each = TrackingControllers(flights), [Expert(flight, max_lag=1) for flight in flights]
    which, steps = generator.integers(len(NAMES), size=40), generator.integers(120, size=40)
    point = np.minimum(steps, together.last[which])
    states = together.states[which, point] + 0.05 * generator.normal(size=(40, 5))
    found, off, distance = together.nearest(which, states, steps - 1)
    np.testing.assert_array_equal(found, point)
    actions = together.action(which, found, off)
    for i, flight in enumerate(which):
        np.testing.assert_allclose(actions[i], each[flight].action(states[i], steps[i]), atol=1e-6)
        expected = together.action(which[i], point[i], states[i] - together.states[flight, point[i]])
        np.testing.assert_array_equal(actions[i], expected)
    np.testing.assert_allclose(distance, np.linalg.norm(off / tolerances(Tolerance()), axis=-1))
    np.testing.assert_allclose(off, states - together.states[which, point], atol=1e-12)


def test_within_the_window_the_nearest_point_is_found(flights):
    together, which, ahead = (
        TrackingControllers(flights, window=range(-6, 4)),
        np.array([0, 1, 2]),
        np.array([20, 30, 10]),
    )
    for shift in (-5, 0, 3):
        point, off, distance = together.nearest(which, together.states[which, ahead + shift], ahead - 1)
        np.testing.assert_array_equal(point, ahead + shift)
        np.testing.assert_allclose(off, 0, atol=1e-12)
        np.testing.assert_allclose(distance, 0, atol=1e-9)


def test_hoops_are_counted_at_each_point(flights):
    passed = TrackingControllers(flights).hoops_passed()
    assert passed.shape == (3, max(flight.steps for flight in flights) + 1)
    assert (np.diff(passed, axis=1) >= 0).all()
    assert passed[:, -1].tolist() == [len(SCENARIOS[name].hoops) for name in NAMES]


def test_flights_of_different_vehicles_are_refused(flights):
    other = replace(flights[1], scenario=replace(flights[1].scenario, dt=0.01))
    with pytest.raises(ValueError, match="must share dt"):
        TrackingControllers([flights[0], other])
