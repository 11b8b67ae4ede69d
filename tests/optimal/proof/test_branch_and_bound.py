"""Times below that of the fastest flight are excluded, none above; the branches always cover all flights."""

import math
import time
from functools import cache

import numpy as np
import pytest

from flatgym import SCENARIOS, Tolerance
from optimal.direct.multistart import search
from optimal.flights.projection_bound import passing_windows
from optimal.proof.branch_and_bound import BranchAndBound, ExcludedBranch, windings
from optimal.proof.branches import Branch, covered
from optimal.proof.dual import Dual
from optimal.proof.initial_multipliers import kink_shares, multipliers
from optimal.proof.tilt_program import TiltProgram
from optimal.proof.time_grid import TimeGrid, time_grid

NAMES = ("horizontal-6", "ground-6", "climb", "hoop", "high-hoop")


@cache
def fastest(name):
    return search(SCENARIOS[name], starts=2).shots[0]


def search_tree(name: str, seconds: float = 30.0, tolerance: Tolerance | None = None) -> BranchAndBound:
    """Return a search over all flights of a scenario that are at most 5 % slower than the fastest known."""
    scenario, shot = SCENARIOS[name], fastest(name)
    kinks = kink_shares(scenario, shot)
    start, longest = multipliers(scenario, shot, kinks), 1.05 * shot.trajectory.duration
    windows = tuple(passing_windows(scenario, longest, tolerance))
    roots = [ExcludedBranch(Branch(winding, windows), start) for winding in windings(scenario, tolerance, longest)]
    return BranchAndBound(scenario, tolerance, kinks, roots, time.monotonic() + seconds)


def near(name: str, share: float) -> TimeGrid:
    return time_grid(share * fastest(name).trajectory.duration, SCENARIOS[name].quadrotor.rate_max, turn=200)


def covers_all_flights(proof: BranchAndBound, name: str) -> bool:
    windows = passing_windows(SCENARIOS[name], 1.05 * fastest(name).trajectory.duration, proof.tolerance)
    found = {each.branch.winding for each in proof.branches}
    assert found == {*windings(proof.scenario, proof.tolerance, 1.05 * fastest(name).trajectory.duration)}
    return all(
        covered([each.branch for each in proof.branches if each.branch.winding == winding], windows)
        for winding in found
    )


@pytest.mark.parametrize("name", NAMES)
def test_too_short_a_time_is_excluded_by_branches_that_cover_all_flights(name):
    proof, grid = search_tree(name), near(name, 0.99)
    assert proof.exclude(grid)
    assert covers_all_flights(proof, name)
    for branch, y in proof.branches:
        dual = Dual(proof.scenario, grid, branch, None, proof.kinks)
        assert (y[dual.signed] >= 0).all()
        assert not dual.possible or all(cut.value + cut.rounding < 0 for cut in dual(y))


@pytest.mark.parametrize("name", NAMES)
def test_the_time_of_a_flight_is_never_excluded_and_the_branches_still_cover_all(name):
    proof = search_tree(name, seconds=0.3)
    assert not proof.exclude(near(name, 1.0))
    assert covers_all_flights(proof, name)
    assert proof.evaluations > 0


def test_fewer_times_are_excluded_within_a_tolerance():
    assert search_tree("horizontal-6", tolerance=Tolerance()).exclude(near("horizontal-6", 0.96))
    assert not search_tree("horizontal-6", 0.3, Tolerance()).exclude(near("horizontal-6", 0.98))
    assert search_tree("horizontal-6", tolerance=Tolerance(1e-6, 1e-6, 1e-6)).exclude(near("horizontal-6", 0.98))


def test_nothing_is_evaluated_after_the_deadline():
    proof = search_tree("high-hoop", seconds=-1.0)
    before = list(proof.branches)
    assert not proof.exclude(near("high-hoop", 0.9))
    assert proof.evaluations == 0
    assert sorted(each.branch.winding for each in proof.branches) == sorted(each.branch.winding for each in before)


def test_excluded_branches_are_reused_for_the_next_time():
    proof, grid = search_tree("high-hoop"), near("high-hoop", 0.98)
    assert proof.exclude(grid)
    first, branches = proof.evaluations, len(proof.branches)
    assert proof.exclude(grid)
    # One evaluation for each branch that can contain a flight.
    assert proof.evaluations - first <= branches < first
    assert len(proof.branches) == branches
    assert proof.exclude(near("high-hoop", 0.95))


def test_mirrored_flights_are_separated_by_their_tilt():
    # Without a turn the fastest vertical flights are mirrored pairs, whose average no weight excludes.
    proof = search_tree("climb")
    assert proof.exclude(near("climb", 0.995))
    held = [each.branch.held for each in proof.branches if each.branch.winding == 0]
    assert len(held) > 1
    assert all(held)


def test_passing_intervals_are_halved():
    proof = search_tree("high-hoop")
    assert proof.exclude(near("high-hoop", 0.995))
    assert len({each.branch.passing for each in proof.branches}) > 1


def test_all_possible_windings_are_considered(generator):
    scenario = SCENARIOS["horizontal-6"]
    for duration in generator.uniform(0.1, 4.0, 30):
        for tolerance in (None, Tolerance(angle=1.0)):
            slack = tolerance.angle if tolerance else 0.0
            considered = windings(scenario, tolerance, duration)
            for winding in range(-9, 10):
                if 2 * math.pi * abs(winding) <= 10.0 * duration + slack:
                    assert winding in considered
                grid = time_grid(duration, 10.0, turn=60)
                if winding not in considered:
                    assert not TiltProgram(scenario.quadrotor, grid, winding, slack).possible
    assert np.ptp(windings(scenario, None, 1.0)) <= 4
