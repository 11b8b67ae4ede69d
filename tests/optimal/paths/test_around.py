"""Corridors around a flight: within the gaps, within floor and ceiling, symmetric, with the flight between."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from flatgym.scenarios.catalogue import SCENARIOS
from flatgym.scenarios.scenario import Hoop, Scenario
from optimal.direct.shooting import solve_coarse
from optimal.flat.planning import pose
from optimal.flat.projection import projected
from optimal.flat.search import starting_flights
from optimal.flights.replay import crossing_times
from optimal.paths.around import corridor_around
from optimal.paths.corridors import Corridor
from optimal.paths.smoothing import SmoothMotion, smoothed


@cache
def laid(scenario: Scenario, winding: int = 0) -> tuple[Corridor, SmoothMotion, tuple[float, ...]]:
    flight = solve_coarse(scenario, winding).trajectory
    passings = crossing_times(flight, scenario)
    motion = smoothed(flight, 0.12, passings)
    return corridor_around(motion, scenario, passings), motion, tuple(passings.tolist())


@pytest.mark.parametrize("name", ["hoop", "slalom"])
def test_outer_paths_pass_each_hoop_together_and_within_its_gap(name):
    corridor, motion, passings = laid(SCENARIOS[name])
    for hoop, passing in zip(SCENARIOS[name].hoops, passings, strict=True):
        ends = np.array([path(passing / motion.duration) for path in corridor.paths])
        aside, along = (ends - hoop.centre) @ hoop.across, (ends - hoop.centre) @ hoop.direction
        assert np.abs(along).max() <= 1e-9
        assert np.abs(aside).max() <= hoop.diameter / 2 + 1e-9
        flown = (motion(passing) - hoop.centre) @ hoop.across
        assert min(aside) - 1e-9 <= flown <= max(aside) + 1e-9


@pytest.mark.parametrize("name", ["hoop", "slalom", "climb", "ground-6"])
def test_the_flight_lies_between_the_outer_paths(name):
    corridor, motion, _ = laid(SCENARIOS[name])
    problem = pose(corridor.paths, SCENARIOS[name].quadrotor, corridor.ends, "explicit", "certified")
    start = projected(problem, motion, np.linspace(0.0, 1.0, 49))
    assert ((start.weights >= 0) & (start.weights <= 1)).all()


def test_outer_paths_rest_at_both_ends():
    for path in laid(SCENARIOS["slalom"])[0].paths:
        assert np.abs(path(np.array([0.0, 1.0]), 1)).max() <= 1e-9


def test_floor_and_ceiling_bound_all_control_points():
    low = replace(SCENARIOS["hoop"], name="low", floor=-0.05, ceiling=5.05)
    for scenario in (SCENARIOS["ground-6"], low):
        bottom, top = scenario.heights
        for path in laid(scenario)[0].paths:
            heights = np.array(path.points)[:, 1]
            assert bottom <= heights.min()
            assert heights.max() <= top


def test_a_body_is_clear_of_the_rims_between_the_outer_paths():
    body = replace(SCENARIOS["hoop"], name="body", quadrotor=replace(SCENARIOS["hoop"].quadrotor, radius=0.15))
    start = starting_flights(body, (0,))[0]
    corridor = corridor_around(smoothed(start.trajectory, 0.12, start.passings), body, start.passings)
    s, share = np.linspace(0.0, 1.0, 2001)[:, None], np.linspace(0.0, 1.0, 21)[:, None]
    between = share * corridor.paths[0](s) + (1 - share) * corridor.paths[1](s)
    for rim in body.hoops[0].rims:
        assert np.hypot(*np.moveaxis(between - rim, -1, 0)).min() >= body.quadrotor.radius


def test_the_mirrored_flight_has_the_mirrored_corridor():
    scenario = SCENARIOS["hoop"]
    corridor, motion, passings = laid(scenario)
    hoop = scenario.hoops[0]
    mirrored = replace(
        scenario, name="mirrored", goal=(-5.0, 5.0), hoops=(Hoop(-hoop.x, hoop.z, hoop.diameter, math.pi - hoop.angle),)
    )
    times = np.linspace(0.0, motion.duration, 1500)
    flipped = SmoothMotion(times, motion(times, 2) * [-1, 1], np.zeros(2))
    other = corridor_around(flipped, mirrored, np.array(passings))
    s = np.linspace(0.0, 1.0, 101)
    for path, image in zip(corridor.paths, reversed(other.paths), strict=True):
        assert np.abs(image(s) * [-1, 1] - path(s)).max() <= 1e-4


def test_a_flight_that_misses_a_hoop_has_no_corridor():
    _, motion, _ = laid(SCENARIOS["hoop"])
    with pytest.raises(ValueError, match="crosses 0 of 1 hoops"):
        corridor_around(motion, SCENARIOS["hoop"], np.array([]))
