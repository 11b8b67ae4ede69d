"""Smooth motions: the same ends and kept positions, at rest upright at both ends, nearer for narrower windows."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from flatgym.scenarios.catalogue import SCENARIOS
from optimal.direct.shooting import solve_coarse
from optimal.flights.replay import crossing_times
from optimal.flights.trajectory import Trajectory
from optimal.paths.smoothing import smoothed


@cache
def coarse(name: str, winding: int) -> Trajectory:
    return solve_coarse(SCENARIOS[name], winding).trajectory


FLIGHTS = [("hoop", 0), ("climb", 1), ("slalom", 0)]


@pytest.mark.parametrize(("name", "winding"), FLIGHTS)
def test_ends_and_kept_positions_stay(name, winding):
    flight, scenario = coarse(name, winding), SCENARIOS[name]
    passings = crossing_times(flight, scenario)
    motion = smoothed(flight, 0.12, passings)
    kept = np.array([0.0, *passings, flight.duration])
    assert motion.duration == flight.duration
    assert np.abs(motion(kept) - flight(kept)).max() <= 1e-9
    assert np.abs(motion([0.0, flight.duration], 1)).max() <= 1e-9


@pytest.mark.parametrize(("name", "winding"), FLIGHTS)
def test_both_ends_are_upright(name, winding):
    motion = smoothed(coarse(name, winding), 0.12)
    side, up = motion([0.0, motion.duration], 2).T
    assert np.abs(np.arctan2(side, up + SCENARIOS[name].quadrotor.gravity)).max() <= 1e-6


def test_a_narrower_window_stays_nearer_to_the_flight():
    flight = coarse("slalom", 0)
    t = np.linspace(0.0, flight.duration, 400)
    distances = [np.abs(smoothed(flight, window)(t) - flight(t)).max() for window in (0.2, 0.1, 0.05)]
    assert distances == sorted(distances, reverse=True)
    assert distances[-1] <= distances[0] / 4  # the error of an average falls with the square of its window


def test_velocity_and_acceleration_are_derivatives():
    motion = smoothed(coarse("hoop", 0), 0.12)
    t, h = np.linspace(0.1, motion.duration - 0.1, 50), 1e-4
    for order in (0, 1):
        difference = (motion(t + h, order) - motion(t - h, order)) / (2 * h)
        assert np.abs(difference - motion(t, order + 1)).max() <= 1e-3
