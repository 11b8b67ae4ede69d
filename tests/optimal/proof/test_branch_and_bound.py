"""Times below that of the fastest flight are excluded, none above; the branches always cover all flights."""

import math
import time
from functools import cache

import numpy as np
import pytest

from flatgym import SCENARIOS, Tolerance
from optimal.direct.multistart import search
from optimal.proof.branch_and_bound import BranchAndBound, windings
from optimal.proof.branches import Branch, covered
from optimal.proof.initial_multipliers import active_hoops, kink_shares, multipliers
from optimal.proof.programme.stations import Passing, Problem
from optimal.proof.programme.tilt_program import tilts
from optimal.proof.programme.time_grid import time_grid
from optimal.proof.stages import passing_left

NAMES = ("horizontal-6", "ground-6", "climb", "hoop", "high-hoop")
TURN = 200


@cache
def fastest(name):
    return search(SCENARIOS[name], starts=2).shots[0]


def search_tree(name: str, seconds: float = 30.0) -> BranchAndBound:
    shot = fastest(name)
    start = multipliers(SCENARIOS[name], shot, kink_shares(SCENARIOS[name], shot))
    return BranchAndBound(start, active_hoops(shot), time.monotonic() + seconds)


def near(name: str, share: float, tolerance: Tolerance | None = None) -> Problem:
    """Return the flights of a share of the best known time."""
    scenario, shot = SCENARIOS[name], fastest(name)
    grid = time_grid(share * shot.trajectory.duration, scenario.quadrotor.rate_max, turn=TURN)
    return Problem(scenario, tolerance, grid.time, kink_shares(scenario, shot))


@pytest.mark.parametrize("name", NAMES)
def test_too_short_a_time_is_excluded_by_branches_that_cover_all_flights(name):
    problem = near(name, 0.99)
    found = search_tree(name).exclude(problem, TURN)
    assert found is not None
    assert covered((branch for branch, _ in found.excluded), windings(problem))
    left = passing_left(problem, Branch(), found.common, Passing.possible(problem))
    assert all(passing_left(problem, branch, stages, left) is None for branch, stages in found.excluded)


def test_a_longer_time_has_the_windings_that_a_shorter_one_could_not_have():
    tree = search_tree("climb")
    for share in (0.6, 0.995):
        problem = near("climb", share)
        found = tree.exclude(problem, TURN)
        assert covered((branch for branch, _ in found.excluded), windings(problem))
    assert len(windings(near("climb", 0.6))) < len(windings(problem))


@pytest.mark.parametrize("name", NAMES)
def test_the_time_of_a_flight_is_never_excluded(name):
    proof = search_tree(name, seconds=0.3)
    assert proof.exclude(near(name, 1.0), TURN) is None
    assert proof.evaluations > 0


def test_fewer_times_are_excluded_within_a_tolerance():
    assert search_tree("horizontal-6").exclude(near("horizontal-6", 0.96, Tolerance()), TURN)
    assert not search_tree("horizontal-6", 0.3).exclude(near("horizontal-6", 0.98, Tolerance()), TURN)
    assert search_tree("horizontal-6").exclude(near("horizontal-6", 0.98, Tolerance(1e-6, 1e-6, 1e-6)), TURN)


def test_nothing_is_evaluated_after_the_deadline():
    proof = search_tree("high-hoop", seconds=-1.0)
    assert proof.exclude(near("high-hoop", 0.9), TURN) is None
    assert proof.evaluations == 0


def test_mirrored_flights_are_separated_by_their_tilt():
    # Without a turn the fastest vertical flights are mirrored pairs, whose average no weight excludes.
    found = search_tree("climb").exclude(near("climb", 0.995), TURN)
    held = [branch.held for branch, _ in found.excluded if branch.winding == 0]
    assert len(held) > 1
    assert all(held)


def test_all_possible_windings_are_considered(generator):
    scenario = SCENARIOS["horizontal-6"]
    for duration in generator.uniform(0.1, 4.0, 30):
        for tolerance in (None, Tolerance(angle=1.0)):
            slack = tolerance.angle if tolerance else 0.0
            considered = windings(Problem(scenario, tolerance, duration))
            for winding in range(-9, 10):
                if 2 * math.pi * abs(winding) <= 10.0 * duration + slack:
                    assert winding in considered
                if winding not in considered:
                    assert not tilts(time_grid(duration, 10.0, turn=60), winding, slack).possible
    assert np.ptp(windings(Problem(scenario, None, 1.0))) <= 4
