"""A flight as the start of eq. (10): projection is the inverse of the motion, and refuses what lies outside."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from flatgym.quadrotor import Quadrotor
from flatgym.scenarios.catalogue import SCENARIOS
from optimal.flat.initial_guess import motion
from optimal.flat.planning import plan, pose
from optimal.flat.projection import projected
from optimal.flat.solution import FlatSolution
from optimal.paths.corridors import Corridor, corridor, paper_corridor


@cache
def paper() -> tuple[Corridor, FlatSolution]:
    walls = paper_corridor(SCENARIOS["horizontal-3"])
    return walls, plan(walls.paths, ends=walls.ends)


def test_projection_gives_the_motion_back():
    walls, solution = paper()
    flight = solution.trajectory
    problem = pose(walls.paths, None, walls.ends, "explicit", "certified")
    start = projected(problem, flight, flight.nodes)
    again = motion(problem, start)
    share = np.linspace(0.0, 1.0, 200)
    assert again.duration == pytest.approx(flight.duration, rel=1e-4)
    assert np.abs(again(share * again.duration) - flight(share * flight.duration)).max() <= 1e-3
    assert np.abs(start.lifted[:, 0]).max() <= np.pi


def test_a_start_from_the_solution_is_solved_at_once():
    walls, solution = paper()
    again = plan(walls.paths, ends=walls.ends, start=solution.trajectory)
    assert again.converged
    assert again.time <= solution.time * (1 + 1e-3)


def test_a_start_outside_the_corridor_is_refused_with_the_place():
    _, solution = paper()
    walls = corridor(SCENARIOS["horizontal-6"])
    with pytest.raises(ValueError, match=r"start leaves the corridor at s = .*, near \("):
        plan(walls.paths, ends=walls.ends, start=solution.trajectory)


def test_a_start_with_another_number_of_outputs_is_refused():
    class Level:
        duration = 1.0

        def __call__(self, t, _order=0):
            return np.zeros((*np.shape(t), 4))

    walls, _ = paper()
    with pytest.raises(ValueError, match="start must be a motion of 2 outputs"):
        plan(walls.paths, ends=walls.ends, start=Level())


def test_a_start_of_another_vehicle_is_refused():
    walls, solution = paper()
    with pytest.raises(ValueError, match="start is a motion of"):
        plan(walls.paths, Quadrotor(thrust_max=30.0), ends=walls.ends, start=solution.trajectory)
