"""Corridors that follow the flight: times only fall, each flight is certified, and the last is close to T*."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from flatgym import Scenario
from flatgym.quadrotor import Quadrotor
from flatgym.scenarios.catalogue import SCENARIOS
from flatgym.scenarios.distributions import DISTRIBUTIONS
from flatgym.scenarios.reference import reference
from optimal.direct.shooting import WINDINGS, solve_coarse, solve_winding
from optimal.flat import moving_corridor
from optimal.flat.initial_guess import motion, slow_start
from optimal.flat.limits import constraint_violation, scaled, slowed_to_limits
from optimal.flat.moving_corridor import AT_HOOPS, confined, follow_flight
from optimal.flat.planning import pose
from optimal.flat.projection import OutsideCorridorError
from optimal.flat.search import ALIKE, search, starting_flights
from optimal.flights.certificate import certify
from optimal.paths.around import WIDTH, corridor_around
from optimal.paths.corridors import paper_corridor
from optimal.paths.regularity import StandstillError

NEAR = 3e-3
"""Greatest relative excess over T*."""


@pytest.mark.parametrize(("name", "winding"), [("hoop", 0), ("climb", 1)])
def test_a_corridor_around_a_coarse_flight_leads_to_the_optimum(name, winding):
    task = SCENARIOS[name]
    steps = list(follow_flight(task, solve_coarse(task, winding).trajectory))
    assert all(step.certificate == certify(step.solution.trajectory, task) for step in steps)
    assert all(step.certificate.holds() for step in steps)
    assert all(after.solution.time < before.solution.time for before, after in pairwise(steps))
    assert 1 <= steps[-1].solution.time / reference(name).time <= 1 + NEAR


@pytest.mark.parametrize(("place", "winding"), [((1e-6, 5.0), 1), ((-0.1, -5.0), -1)])
def test_beside_the_vertical_the_fastest_turn_is_flown(place, winding):
    scenario = Scenario("beside the vertical", (0, 0), place)
    flown = next(follow_flight(scenario, solve_coarse(scenario, winding).trajectory)).solution
    assert 1 <= flown.time / solve_winding(scenario, winding).trajectory.duration <= 1 + NEAR
    assert certify(flown.trajectory, scenario).holds()


def test_corridors_follow_a_slow_flight_to_the_optimum():
    task = SCENARIOS["horizontal-3"]
    slow = replace(task, quadrotor=Quadrotor(thrust_max=13.0, rate_max=5.0))
    start = solve_coarse(slow, 0).trajectory
    steps = list(follow_flight(task, start))
    times = [start.duration, *(step.solution.time for step in steps)]
    assert times == sorted(times, reverse=True)
    assert len(steps) > 1
    assert steps[-1].solution.time <= reference("horizontal-3").time * (1 + NEAR)
    assert len(list(follow_flight(task, start, most=1))) == 1


@pytest.mark.parametrize(("weight", "touches"), [(0.0, True), (0.5, False), (1.0, True)])
def test_a_flight_is_confined_by_the_outer_paths_it_touches_away_from_hoops(weight, touches):
    task = SCENARIOS["horizontal-3"]
    walls = paper_corridor(task)
    problem = pose(walls.paths, None, walls.ends, "explicit", "certified")
    slow = slow_start(problem, 8)
    flight = motion(problem, replace(slow, weights=np.full_like(slow.weights, weight)))
    assert confined(flight, np.array([])) == touches
    assert not confined(flight, np.linspace(0.0, flight.duration, 1 + int(flight.duration / AT_HOOPS)))


@pytest.mark.parametrize("vehicle", [Quadrotor(thrust_min=0.5, thrust_max=30.0, rate_max=5.0), Quadrotor(radius=0.15)])
def test_other_limits_and_bodies_are_flown(vehicle):
    task = replace(SCENARIOS["hoop"], name="other", quadrotor=vehicle)
    found = search(task, (0,))
    assert found.steps[-1].certificate.holds()
    best = solve_coarse(task, 0).trajectory.duration  # of the coarse grid, which is not below T* of a point
    assert found.steps[-1].solution.time <= best * (1 + 5e-3)


def test_a_draw_at_low_thrust_is_flown():
    # The wide corridors of this draw left no flight: at low thrust the rate is sensitive to their third derivatives.
    task = DISTRIBUTIONS["random-hoops"].scenario(3)
    found = search(task, WINDINGS)
    assert found.steps[-1].certificate.holds()
    assert found.steps[-1].solution.time <= solve_coarse(task, found.winding).trajectory.duration * (1 + NEAR)


@pytest.mark.parametrize("error", [OutsideCorridorError, StandstillError])
def test_a_corridor_that_cannot_be_laid_ends_the_sequence(monkeypatch, error):
    def refused(*_, **__):
        raise error("refused")

    monkeypatch.setattr(moving_corridor, "plan", refused)
    task = SCENARIOS["horizontal-3"]
    assert list(follow_flight(task, solve_coarse(task, 0).trajectory)) == []


def test_the_width_of_the_corridors_can_be_chosen(monkeypatch):
    widths = []
    monkeypatch.setattr(
        moving_corridor, "corridor_around", lambda *given: widths.append(given[-1]) or corridor_around(*given)
    )
    task = SCENARIOS["horizontal-3"]
    start = solve_coarse(task, 0).trajectory
    for width in (WIDTH, WIDTH / 2):
        next(follow_flight(task, start, width=width))
    assert widths == [WIDTH, WIDTH / 2]


def test_a_start_that_is_not_faster_on_the_first_grid_is_not_refined():
    task = SCENARIOS["horizontal-3"]
    start = solve_coarse(task, 0)
    first = next(follow_flight(task, start.trajectory)).solution
    assert first.first_time < first.time * (1 + NEAR)
    assert not list(follow_flight(task, start.trajectory, slowest=first.first_time))
    again = next(follow_flight(task, start.trajectory, slowest=first.first_time * (1 + 1e-9))).solution
    assert again.time == first.time


def test_mirror_images_are_one_start():
    climb = SCENARIOS["climb"]
    left, right = (solve_coarse(climb, winding) for winding in (-1, 1))
    assert left.trajectory.duration == pytest.approx(right.trajectory.duration, rel=ALIKE)
    assert len(starting_flights(climb, (-1, 1))) == 1
    assert len(starting_flights(replace(climb, goal=(0.01, 5.0)), (-1, 1))) == 2


def test_a_slow_down_keeps_limits_and_is_the_smallest():
    task = SCENARIOS["horizontal-3"]
    flight = next(follow_flight(task, solve_coarse(task, 0).trajectory)).solution.trajectory
    for faster in (1.0005, 1.004):
        fast = scaled(flight, 1 / faster)
        assert constraint_violation(fast) > 0
        slowed = slowed_to_limits(fast, 1.03)
        assert constraint_violation(slowed) == 0
        assert flight.duration * (1 - 1e-3) <= slowed.duration <= flight.duration * (1 + 1e-5)
    assert slowed_to_limits(scaled(flight, 2**-0.5), 1.03) is None
