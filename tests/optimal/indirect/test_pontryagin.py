"""Extremals against shooting, an independent integration, symmetries, and the sign conditions."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flatgym import SCENARIOS, Hoop, Quadrotor, Scenario
from optimal.direct.shooting import solve_winding
from optimal.flights.certificate import certify
from optimal.indirect.extremal import ControlArc, singular_step
from optimal.indirect.pontryagin import fastest, pontryagin

HORIZONTALS = [f"horizontal-{distance}" for distance in (3, 6, 9, 12, 15)]
CASES = [*((name, 0) for name in (*HORIZONTALS, "diagonal")), *(("climb", 1), ("climb", -1), ("drop", 1))]
"""Named scenarios in free space and their best windings."""


@cache
def solved(name, winding=0):
    return pontryagin(SCENARIOS[name], winding)


def goal(x, z, **parts):
    return Scenario("goal", (0.0, 0.0), (x, z), **parts)


@pytest.mark.parametrize(("name", "winding"), CASES)
def test_named_scenarios_agree_with_shooting_and_are_certified(name, winding):
    extremal, scenario = solved(name, winding), SCENARIOS[name]
    direct = solve_winding(scenario, winding, nodes=200).trajectory.duration
    assert extremal.converged, extremal.message
    # The direct flight holds its controls over a step, so it cannot be faster.
    assert direct - 1e-4 < extremal.time < direct + 1e-8
    assert extremal.time == extremal.trajectory.duration == extremal.switches[-1].end
    certificate = certify(extremal.trajectory, scenario)
    assert certificate.holds()
    assert certificate.max_control_violation < 1e-9
    assert certificate.lower_bound < extremal.time


@pytest.mark.parametrize(("name", "winding"), CASES)
def test_all_equations_and_signs_hold(name, winding):
    extremal = solved(name, winding)
    assert extremal.residual < 1e-10
    assert extremal.sign_agreement == 1.0
    assert extremal.hamiltonian_drift < 1e-10


def test_random_goals_agree_with_shooting(generator):
    for _ in range(5):
        scenario = goal(*generator.uniform(-10, 10, 2))
        times = {winding: solve_winding(scenario, winding).trajectory.duration for winding in (0, 1, -1)}
        best = min(times, key=lambda winding: times[winding])
        extremal = pontryagin(scenario, best)
        assert extremal.converged
        assert -5e-4 < extremal.time - times[best] < 1e-8
        assert certify(extremal.trajectory, scenario).holds()


@pytest.mark.parametrize("limits", [{"thrust_min": 0.0}, {"rate_max": 4.0}, {"thrust_max": 14.0}, {"gravity": 3.7}])
def test_other_limits(limits):
    scenario = goal(4.0, 2.0, quadrotor=Quadrotor(**limits))
    extremal = pontryagin(scenario)
    assert extremal.converged
    assert abs(extremal.time - solve_winding(scenario).trajectory.duration) < 5e-4
    assert certify(extremal.trajectory, scenario).holds()


@pytest.mark.parametrize("height", [-0.15, 0.15, -0.12])
def test_a_short_vertical_flight_tilts_though_the_direct_solution_stays_straight(height):
    scenario, q = goal(0.0, height), Quadrotor()
    extremal = pontryagin(scenario)
    straight = np.sqrt(2 * abs(height) * (1 / (q.gravity - q.thrust_min) + 1 / (q.thrust_max - q.gravity)))
    assert extremal.converged
    assert 0.998 * straight < extremal.time < straight - 2e-4
    assert extremal.time == pytest.approx(pontryagin(goal(0.01, height)).time, abs=1e-3)
    assert certify(extremal.trajectory, scenario).holds()


def test_structure_of_a_long_horizontal():
    arcs = solved("horizontal-15").switches
    assert [arc.rate for arc in arcs] == ["max", "singular", "max"]
    assert all(arc.thrust == 20.0 for arc in arcs)
    assert isinstance(arcs[0], ControlArc)
    assert all(first.end == second.start for first, second in pairwise(arcs))
    assert arcs[0].end - arcs[0].start == pytest.approx(arcs[2].end - arcs[2].start, abs=1e-9)


@pytest.mark.parametrize(
    ("place", "winding", "arc", "rate", "length"),
    [
        ((-2.958678001827746, -7.386819864195344), 0, 2, "singular", 2.4e-3),  # p touches zero where the rate switches
        ((-1.0291179847924763, 5.97878981926268), -1, 5, "singular", 0.3e-3),  # p touches zero within a turn
        ((5.0, 5.0), -1, 4, "min", 3.3e-3),  # the thrust rises once more before the end
    ],
)
def test_arcs_shorter_than_a_step_of_the_direct_solution_are_inserted(place, winding, arc, rate, length):
    extremal = pontryagin(goal(*place), winding)
    assert extremal.converged
    assert extremal.switches[arc].rate == rate
    assert extremal.switches[arc].end - extremal.switches[arc].start == pytest.approx(length, abs=1e-4)


def test_mirrored_goals_take_the_same_time_with_mirrored_costates():
    for winding in (0, 1):
        there, mirrored = pontryagin(goal(3.0, 2.0), winding), pontryagin(goal(-3.0, 2.0), -winding)
        assert there.time == pytest.approx(mirrored.time, abs=1e-9)
        np.testing.assert_allclose(there.q0 * [-1, 1], mirrored.q0, atol=1e-8)
        np.testing.assert_allclose(there.q1 * [-1, 1], mirrored.q1, atol=1e-8)


def test_reversed_flights_take_the_same_time():
    # A flight from A to B reversed in time is a flight from B to A with reversed turns.
    assert pontryagin(goal(3.0, 2.0)).time == pytest.approx(pontryagin(goal(3.0, -2.0)).time, abs=1e-9)


def test_time_grows_with_distance_at_the_rate_given_by_the_costate():
    times = [solved(name).time for name in HORIZONTALS]
    assert all(near < far for near, far in pairwise(times))
    # dT/dD is the position costate -q1, the marginal cost of a more distant goal.
    step = 1e-4
    slope = (pontryagin(goal(6.0 + step, 0.0)).time - pontryagin(goal(6.0 - step, 0.0)).time) / (2 * step)
    assert slope == pytest.approx(-solved("horizontal-6").q1[0], abs=1e-6)


def test_the_flight_agrees_with_an_independent_integration_of_its_controls():
    flight = solved("diagonal").trajectory
    state = flight.state(0.0)
    for begin, end in pairwise(flight.breakpoints):

        def derivative(t, y, begin=begin, end=end):
            return flight.quadrotor.derivative(y, flight.control(np.clip(t, begin, end - 1e-12)))

        state = solve_ivp(derivative, (begin, end), state, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(state, flight.state(flight.duration), atol=1e-8)
    np.testing.assert_allclose(state, SCENARIOS["diagonal"].goal_state, atol=1e-8)


def test_each_order_is_the_time_derivative_of_the_one_before():
    flight, step = solved("diagonal").trajectory, 1e-5
    time = (flight.breakpoints[:-1] + flight.breakpoints[1:]) / 2
    for order in range(3):
        difference = (flight(time + step, order) - flight(time - step, order)) / (2 * step)
        np.testing.assert_allclose(difference, flight(time, order + 1), atol=1e-5)
    assert flight.state(0.3).shape == (5,)
    assert flight.control(np.zeros((2, 3))).shape == (2, 3, 2)
    assert flight.sample(0.01).time[-1] == flight.duration


def test_singular_steps_compose(generator):
    state, q, q1 = generator.normal(size=5), np.array([0.3, 0.2]), np.array([-0.4, 0.1])
    whole = singular_step(state, 20.0, q, q1, 0.5, 9.81)
    half = singular_step(state, 20.0, q, q1, 0.2, 9.81)
    np.testing.assert_allclose(singular_step(half, 20.0, q + 0.2 * q1, q1, 0.3, 9.81), whole, atol=1e-13)
    # The tilt turns as q does.
    angles = np.arctan2(*q), np.arctan2(*(q + 0.5 * q1))
    assert whole[4] - state[4] == pytest.approx(angles[1] - angles[0], abs=1e-14)


def test_the_fastest_winding_is_found():
    climb = fastest(SCENARIOS["climb"], (0, 1))
    assert climb.winding == 1
    assert climb.time == pytest.approx(1.30037, abs=1e-4)
    with pytest.raises(ValueError, match="at least one winding"):
        fastest(SCENARIOS["climb"], ())


@pytest.mark.parametrize(
    ("field", "value"), [("hoops", (Hoop(2.5, 2.5, 0.5),)), ("floor", 0.0), ("ceiling", 9.0), ("floor", -1.0)]
)
def test_hoops_and_heights_are_refused_with_advice(field, value):
    scenario = replace(SCENARIOS["diagonal"], **{field: value})
    with pytest.raises(ValueError, match=rf"Scenario\.{field} .*method=\"shooting\""):
        pontryagin(scenario)


@pytest.mark.parametrize("winding", [0.5, math.nan, "one"])
def test_fractional_windings_are_refused(winding):
    with pytest.raises(ValueError, match="whole number of turns"):
        pontryagin(SCENARIOS["diagonal"], winding)


def test_an_unconverged_extremal_has_no_time():
    # Sixty turns take longer than any flight that the direct solver considers.
    extremal = pontryagin(goal(0.5, 0.0), 60)
    assert not extremal.converged
    assert extremal.time == math.inf
    assert extremal.trajectory is None
    assert extremal.message.startswith("Not solved")
