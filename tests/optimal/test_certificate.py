"""Certificates hold for true flights and fail for broken ones, each in the field that was broken."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Quadrotor, Scenario
from optimal.certificate import Certificate, certify
from optimal.shooting import shoot


@pytest.fixture(scope="module", params=["ground-6", "hoop", "slalom", "loop"])
def flown(request):
    scenario = SCENARIOS[request.param]
    return scenario, shoot(scenario, -1 if request.param == "loop" else 0).trajectory


def test_true_flights_are_certified(flown):
    scenario, flight = flown
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


def test_broken_flights_fail_where_they_are_broken(flown):
    scenario, flight = flown
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


def test_a_rate_beyond_its_limit_is_seen(flown):
    scenario, flight = flown
    certificate = certify(flight, replace(scenario, quadrotor=Quadrotor(rate_max=9.9)))
    assert certificate.max_control_violation == pytest.approx(10 / 9.9 - 1, abs=1e-6)
    assert not certificate.holds()


def test_heights_are_held_against_the_arcs():
    ground, free = SCENARIOS["ground-6"], SCENARIOS["horizontal-6"]
    flight = shoot(free).trajectory
    depth = -min(flight(np.linspace(0, flight.duration, 20001))[:, 1])
    certificate = certify(flight, ground)
    assert certificate.max_path_violation == pytest.approx(depth, abs=1e-6)
    assert depth > 1e-3
    assert not certificate.holds()
    top = float(flight(np.linspace(0, flight.duration, 20001))[:, 1].max())
    low_ceiling = replace(free, ceiling=top - 0.01)
    assert certify(flight, low_ceiling).max_path_violation == pytest.approx(0.01, abs=1e-6)


def test_hoops_missed_or_flown_backwards_are_seen():
    hoop, diagonal = SCENARIOS["hoop"], SCENARIOS["diagonal"]
    flight = shoot(diagonal).trajectory
    narrow = replace(hoop, hoops=(Hoop(2.5, 2.5, 0.1),))
    clearance = certify(flight, narrow).hoop_clearance
    assert -0.5 < clearance < -1e-3
    assert certify(flight, replace(hoop, hoops=(Hoop(2.5, 2.5, 3.0, math.pi),))).hoop_clearance == -math.inf
    twice = replace(hoop, hoops=(Hoop(2.5, 2.5, 3.0), Hoop(1.0, 1.0, 3.0)))
    assert certify(flight, twice).hoop_clearance == -math.inf
    assert not certify(flight, narrow).holds()


def test_a_body_that_grazes_a_rim_is_seen():
    # Through the gap with room to spare where it crosses the line, but past the rim at an angle.
    hoop = Hoop(2.5, 2.5, 0.7, math.pi / 4 + 1.2)
    scenario = replace(SCENARIOS["hoop"], hoops=(hoop,))
    flight = shoot(scenario).trajectory
    body = replace(scenario, quadrotor=Quadrotor(radius=0.12))
    times = np.linspace(0, flight.duration, 20001)
    rims = [hoop.centre + side * hoop.across * hoop.diameter / 2 for side in (-1, 1)]
    nearest = min(np.hypot(*(flight(times) - rim).T).min() for rim in rims)
    certificate = certify(flight, body)
    assert certificate.max_path_violation == pytest.approx(0.12 - nearest, abs=1e-3)
    assert nearest < 0.12
    assert not certificate.holds()


def test_nothing_shows_nothing():
    certificate = certify(None, SCENARIOS["hoop"])
    assert not certificate.holds()
    assert certificate.gap == certificate.replay_error == math.inf
    assert certificate.hoop_clearance == -math.inf
    flight = shoot(SCENARIOS["horizontal-3"]).trajectory
    assert not certify(broken(flight, "states", (3, 2), math.nan), SCENARIOS["horizontal-3"]).holds()
    assert not Certificate().holds()


def test_the_wrong_goal_is_seen():
    flight = shoot(SCENARIOS["horizontal-3"]).trajectory
    elsewhere = Scenario("elsewhere", (0, 0), (3.01, 0))
    assert certify(flight, elsewhere).terminal_error == pytest.approx(0.01, abs=1e-6)
