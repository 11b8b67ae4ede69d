"""Certificates hold for valid flights and fail for broken ones, each in the field that was broken."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Quadrotor, Scenario
from optimal.direct.shooting import solve_winding
from optimal.flat.limits import constraint_violation
from optimal.flat.splines import SplineSpace
from optimal.flat.trajectory import FlatTrajectory
from optimal.flights.certificate import Certificate, certify, control_range
from optimal.flights.replay import converged_replay, hoop_crossings
from optimal.flights.trajectory import Trajectory
from optimal.indirect.pontryagin import pontryagin
from optimal.paths.curves import PolynomialPath, Resting, smoothstep
from optimal.systems import PlanarQuadrotor


@pytest.fixture(scope="module", params=["ground-6", "hoop", "slalom", "loop"])
def solved(request):
    scenario = SCENARIOS[request.param]
    return scenario, solve_winding(scenario, -1 if request.param == "loop" else 0).trajectory


def test_valid_flights_are_certified(solved):
    scenario, flight = solved
    certificate = certify(flight, scenario)
    assert certificate.holds()
    assert certificate.max_control_violation == 0
    assert certificate.replay_error < 1e-8
    assert 0 < certificate.lower_bound < flight.duration
    assert math.isclose(certificate.gap, flight.duration / certificate.lower_bound - 1)


def broken(flight, part, index, amount):
    values = getattr(flight, part).copy()
    values[index] += amount
    return replace(flight, **{part: values})


def test_broken_flights_fail_where_they_are_broken(solved):
    scenario, flight = solved
    middle = len(flight.controls) // 2
    slower = replace(flight, breakpoints=flight.breakpoints * 1.001)
    for field, wrong in {
        "max_control_violation": broken(flight, "controls", (middle, 0), 25.0),
        "replay_error": broken(flight, "states", (middle, 0), 1e-4),
        "terminal_error": slower,
    }.items():
        certificate = certify(wrong, scenario)
        assert getattr(certificate, field) > 1e-5, field
        assert not certificate.holds()


def test_a_rate_beyond_its_limit_is_detected(solved):
    scenario, flight = solved
    certificate = certify(flight, replace(scenario, quadrotor=Quadrotor(rate_max=9.9)))
    assert certificate.max_control_violation == pytest.approx(10 / 9.9 - 1, abs=1e-6)
    assert not certificate.holds()


def test_heights_are_checked_on_the_arcs():
    ground, free = SCENARIOS["ground-6"], SCENARIOS["horizontal-6"]
    flight = solve_winding(free).trajectory
    depth = -min(flight(np.linspace(0, flight.duration, 20001))[:, 1])
    certificate = certify(flight, ground)
    assert certificate.max_path_violation == pytest.approx(depth, abs=1e-6)
    assert depth > 1e-3
    assert not certificate.holds()
    top = float(flight(np.linspace(0, flight.duration, 20001))[:, 1].max())
    low_ceiling = replace(free, ceiling=top - 0.01)
    assert certify(flight, low_ceiling).max_path_violation == pytest.approx(0.01, abs=1e-6)


def test_hoops_missed_or_passed_backwards_are_detected():
    hoop, diagonal = SCENARIOS["hoop"], SCENARIOS["diagonal"]
    flight = solve_winding(diagonal).trajectory
    narrow = replace(hoop, hoops=(Hoop(2.5, 2.5, 0.1),))
    clearance = certify(flight, narrow).hoop_clearance
    assert -0.5 < clearance < -1e-3
    assert certify(flight, replace(hoop, hoops=(Hoop(2.5, 2.5, 3.0, math.pi),))).hoop_clearance == -math.inf
    twice = replace(hoop, hoops=(Hoop(2.5, 2.5, 3.0), Hoop(1.0, 1.0, 3.0)))
    assert certify(flight, twice).hoop_clearance == -math.inf
    assert not certify(flight, narrow).holds()


def test_a_crossing_between_two_arcs_of_the_replay_is_found(generator):
    # By rounding, one arc may end before the line of the hoop, and the next one begin on it.
    flight = solve_winding(SCENARIOS["diagonal"]).trajectory
    _, _, arcs = converged_replay(flight, SCENARIOS["diagonal"])
    states, ends = arcs.state, np.append(0.0, np.cumsum(arcs.dt))
    for k in range(5, len(arcs) - 5):
        ahead = math.atan2(states[k, 3], states[k, 2])
        for angle in ahead + generator.uniform(-0.5, 0.5, size=4):
            hoop = Hoop(*states[k, :2].tolist(), 0.1, angle)
            ((time, clearance),) = hoop_crossings(arcs, replace(SCENARIOS["hoop"], hoops=(hoop,)))
            assert time == pytest.approx(ends[k], abs=1e-9)
            assert clearance == pytest.approx(0.05, abs=1e-9)


def test_a_body_that_touches_a_rim_is_detected():
    # The crossing has clearance to spare, but the path passes the rim at an angle.
    hoop = Hoop(2.5, 2.5, 0.7, math.pi / 4 + 1.2)
    scenario = replace(SCENARIOS["hoop"], hoops=(hoop,))
    flight = solve_winding(scenario).trajectory
    body = replace(scenario, quadrotor=Quadrotor(radius=0.12))
    times = np.linspace(0, flight.duration, 20001)
    rims = [hoop.centre + side * hoop.across * hoop.diameter / 2 for side in (-1, 1)]
    nearest = min(np.hypot(*(flight(times) - rim).T).min() for rim in rims)
    certificate = certify(flight, body)
    assert certificate.max_path_violation == pytest.approx(0.12 - nearest, abs=1e-3)
    assert nearest < 0.12
    assert not certificate.holds()


def test_without_a_valid_flight_nothing_is_certified():
    certificate = certify(None, SCENARIOS["hoop"])
    assert not certificate.holds()
    assert certificate.gap == certificate.replay_error == math.inf
    assert certificate.hoop_clearance == -math.inf
    flight = solve_winding(SCENARIOS["horizontal-3"]).trajectory
    assert not certify(broken(flight, "states", (3, 2), math.nan), SCENARIOS["horizontal-3"]).holds()
    assert not Certificate().holds()


def test_a_wrong_goal_is_detected():
    flight = solve_winding(SCENARIOS["horizontal-3"]).trajectory
    elsewhere = Scenario("elsewhere", (0, 0), (3.01, 0))
    assert certify(flight, elsewhere).terminal_error == pytest.approx(0.01, abs=1e-6)


def flat(path=None, bump=0.0, at=0.4, width=1e-3):
    """Return a slow flat flight 4 m to the right, with b(s) = 0.1 except for a bump between two close nodes."""
    nodes = np.array([0.0, at - width, at, at + width, 1.0])
    space = SplineSpace(nodes, 3, 2)
    speed = np.full(space.size, 0.1)
    speed[(space.centres > at - width / 2) & (space.centres < at + width / 2)] += bump
    still = SplineSpace(nodes, 4, 2)
    path = path or PolynomialPath((tuple((4.0 * smoothstep(4)).coef), (0.0,)))
    return FlatTrajectory(
        PlanarQuadrotor(), (path,), nodes, still.spline(np.zeros((still.size, 0))), space.spline(speed)
    )


def with_knots(flight, nodes):
    """Return a flight whose intervals are not its smooth pieces, so that samples miss a narrow bump."""
    return replace(flight, nodes=np.array(nodes))


FOUR = Scenario("four", (0, 0), (4, 0))


def test_a_spike_between_the_samples_is_detected():
    assert certify(flat(), FOUR).holds()
    spike = with_knots(flat(bump=0.02, at=0.4051, width=2e-4), [0.0, 1.0])
    # 32 points of an interval miss it: every sampled value is well within the limits.
    time = spike.duration * np.arange(1, 32) / 32
    thrust, rate = spike.control(time).T
    assert np.all((thrust < 19) & (thrust > 2) & (np.abs(rate) < 9))
    assert constraint_violation(spike) == 0
    certificate = certify(spike, FOUR)
    assert certificate.max_control_violation > 0.01
    assert not certificate.holds()


def test_control_ranges_of_flat_flights_are_tight():
    flight = flat()
    controls = flight.control(np.linspace(0, flight.duration, 20001))
    least, greatest = control_range(flight)
    assert np.all(least <= controls.min(axis=0) + 1e-12)
    assert np.all(greatest >= controls.max(axis=0) - 1e-12)
    assert np.hypot(least[0] - controls[:, 0].min(), greatest[0] - controls[:, 0].max()) < 1e-6
    assert greatest[1] == pytest.approx(np.abs(controls[:, 1]).max(), abs=1e-6)
    assert least[1] == -greatest[1]
    # A reparametrised path is bounded through the composition.
    rested = flat(Resting(PolynomialPath(((0.0, 4.0), (0.0, 0.5, -0.5)))))
    controls = rested.control(np.linspace(0, rested.duration, 20001))
    least, greatest = control_range(rested)
    assert greatest[0] == pytest.approx(controls[:, 0].max(), abs=1e-6)
    assert least[0] == pytest.approx(controls[:, 0].min(), abs=1e-6)
    assert greatest[1] == pytest.approx(np.abs(controls[:, 1]).max(), abs=1e-6)


def test_heights_and_distances_of_flat_flights_are_bounds():
    flight = flat(Resting(PolynomialPath(((0.0, 4.0), (0.0, 0.5, -0.5)))))
    path = flight(np.linspace(0, flight.duration, 20001))
    assert flight.support_bound(np.array([0.0, 1.0])) == pytest.approx(0.125, abs=1e-10)
    point = np.array([1.9, 0.3])
    nearest = np.hypot(*(path - point).T).min()
    assert nearest - 1e-6 < flight.distance_bound(point) <= nearest
    task = Scenario("four", (0, 0), (4, 0), ceiling=0.1)
    assert certify(flight, task).max_path_violation == pytest.approx(0.025, abs=1e-10)


class Opaque:
    """A flight with the values of another one and without its class."""

    def __init__(self, flight):
        self.flight = flight
        self.quadrotor, self.duration, self.breakpoints = flight.quadrotor, flight.duration, flight.breakpoints

    def __call__(self, t, order=0):
        return self.flight(t, order)

    def state(self, t):
        return self.flight.state(t)

    def control(self, t):
        return self.flight.control(t)


def test_an_unknown_class_of_flight_has_no_bounds_between_instants():
    certificate = certify(Opaque(solve_winding(SCENARIOS["horizontal-3"]).trajectory), SCENARIOS["horizontal-3"])
    assert certificate.max_control_violation == math.inf
    assert certificate.replay_error < 1e-8
    assert not certificate.holds()
    unknown = flat(lambda s, order=0: PolynomialPath((tuple((4.0 * smoothstep(4)).coef), (0.0,)))(s, order))
    assert certify(unknown, FOUR).max_control_violation == math.inf


def test_rates_on_singular_arcs_are_bounded_by_the_costate():
    flight = pontryagin(SCENARIOS["horizontal-6"]).trajectory
    rate = np.abs(flight.control(np.linspace(0, flight.duration, 20001))[:, 1]).max()
    assert control_range(flight)[1, 1] == pytest.approx(rate, rel=1e-12)
    mild = replace(flight, controls=np.where(np.isnan(flight.controls), np.nan, [[20.0, 0.0]]))
    time = np.linspace(0, flight.duration, 200001)
    following = np.isnan(mild.controls[np.clip(np.searchsorted(mild.breakpoints, time) - 1, 0, None), 1])
    sampled = np.abs(mild.control(time)[following, 1]).max()
    assert sampled * (1 - 1e-12) <= control_range(mild)[1, 1] <= sampled * (1 + 1e-4)
    assert certify(flight, SCENARIOS["horizontal-6"]).holds()


def test_long_arcs_are_divided_before_the_tilt_turns_round():
    # One arc of four whole turns: its heights are those of the arc, not of a chord.
    q = Quadrotor()
    control = np.array([[15.0, 8 * math.pi / 3]])
    states = np.stack([np.zeros(5), q.step(np.zeros(5), control[0], 3.0)])
    flight = Trajectory(np.array([0.0, 3.0]), states, control, q)
    heights = flight(np.linspace(0, 3.0, 200001))[:, 1]
    task = Scenario("turns", (0, 0), (1, 0), floor=-1.0)
    assert certify(flight, task).max_path_violation == pytest.approx(-1.0 - heights.min(), abs=1e-8)


def test_the_smallest_violation_beyond_rounding_is_rejected():
    scenario = SCENARIOS["horizontal-3"]
    flight = solve_winding(scenario).trajectory
    assert certify(flight, scenario).holds()
    least = replace(scenario, quadrotor=replace(scenario.quadrotor, rate_max=10.0 - 1e-6))
    assert 1e-9 < certify(flight, least).max_control_violation < 1e-6
    assert not certify(flight, least).holds()
    top = float(flight(np.linspace(0, flight.duration, 200001))[:, 1].max())
    low = replace(scenario, ceiling=top - 1e-8)
    assert 1e-9 < certify(flight, low).max_path_violation < 1e-7
    assert not certify(flight, low).holds()
