"""Corridors that follow the flight: times only fall, each flight is certified, and the last is close to T*."""

from __future__ import annotations

from itertools import pairwise

import pytest

from flatgym import Scenario
from flatgym.scenarios.catalogue import SCENARIOS
from flatgym.scenarios.reference import reference
from optimal.direct.shooting import solve_coarse, solve_winding
from optimal.flat.moving_corridor import follow_flight
from optimal.flights.certificate import certify

NEAR = 3e-3
"""Greatest relative excess over T*."""


@pytest.mark.parametrize(("name", "winding"), [("hoop", 0), ("high-hoop", 1), ("climb", 1)])
def test_a_corridor_around_a_coarse_flight_leads_to_the_optimum(name, winding):
    steps = list(follow_flight(SCENARIOS[name], solve_coarse(SCENARIOS[name], winding).trajectory))
    assert all(certify(step.solution.trajectory, SCENARIOS[name]).holds() for step in steps)
    assert all(after.solution.time < before.solution.time for before, after in pairwise(steps))
    assert 1 <= steps[-1].solution.time / reference(name).time <= 1 + NEAR


@pytest.mark.parametrize(("place", "winding"), [((1e-6, 5.0), 1), ((-0.1, -5.0), -1)])
def test_beside_the_vertical_the_fastest_turn_is_flown(place, winding):
    scenario = Scenario("beside the vertical", (0, 0), place)
    flown = next(follow_flight(scenario, solve_coarse(scenario, winding).trajectory)).solution
    assert 1 <= flown.time / solve_winding(scenario, winding).trajectory.duration <= 1 + NEAR
    assert certify(flown.trajectory, scenario).holds()
