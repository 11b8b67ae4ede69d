"""Forged proofs are rejected: `Proof.check` trusts neither branches, nor grid, nor verdict."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from flatgym import SCENARIOS, Quadrotor
from flatgym.task.transition import CONTACT_SLACK
from optimal.direct.multistart import search
from optimal.proof.branch_and_bound import BranchAndBound, ExcludedBranch
from optimal.proof.branches import Branch, covered
from optimal.proof.dual import Dual
from optimal.proof.initial_multipliers import multipliers
from optimal.proof.lower_bound import Proof, Verdict, prove
from optimal.proof.step_bound import least_steps, relaxed_scenario
from optimal.proof.time_grid import TimeGrid, time_grid


def forged(scenario, branch, duration, flown, vehicle=None):
    """Return a proof for one branch, or for another vehicle, that claims to be for all flights."""
    flies = scenario if vehicle is None else replace(scenario, quadrotor=vehicle)
    start, grid = multipliers(flies, search(flies).shots[0], ()), time_grid(duration, flies.quadrotor.rate_max)
    roots = [ExcludedBranch(replace(branch, winding=winding), start) for winding in range(-3, 4)]
    search_tree = BranchAndBound(flies, None, (), roots, time.monotonic() + 20)
    assert search_tree.exclude(grid)
    return Proof(scenario, None, grid.time, flown, Verdict.CLOSED, grid=grid, excluded=tuple(search_tree.branches))


def test_a_branch_outside_the_window_covers_nothing():
    assert not covered([Branch(0, ((0.0, 0.1),))], [(0.3, 0.6)])
    assert not forged(SCENARIOS["hoop"], Branch(0, ((0.02, 0.03),)), 1.5, 1.6).check()


def test_a_grid_of_another_rate_proves_nothing():
    assert not forged(SCENARIOS["horizontal-6"], Branch(0), 1.3, 1.4, Quadrotor(rate_max=5)).check()


def test_windows_of_a_shorter_flight_prove_nothing():
    found = prove("hoop")
    assert found.check()
    assert not replace(found, flown=found.time * 0.99).check()


def test_the_verdict_impossible_is_checked():
    assert not Proof(SCENARIOS["hoop"], None, math.inf, math.inf, Verdict.IMPOSSIBLE).check()


def test_tiny_multipliers_give_the_same_result():
    dual = Dual(SCENARIOS["hoop"], TimeGrid(90, 60, 10.0), Branch(0, ((0.45, 0.55),)))
    y = np.random.default_rng(7).normal(size=dual.size)
    y[-2:] = abs(y[-2:])
    for cut, tiny in zip(dual(y), dual(1e-170 * y), strict=True):
        assert tiny.value / 1e-170 == pytest.approx(cut.value, rel=1e-9)


def test_the_relaxed_floor_includes_the_contact_slack():
    assert relaxed_scenario(SCENARIOS["ground-6"]).floor <= -CONTACT_SLACK


def test_a_time_just_short_of_a_step_does_not_exclude_that_step():
    scenario = SCENARIOS["horizontal-6"]
    for steps in range(1, 200):
        whole = steps * scenario.dt
        just, short = (Proof(scenario, None, t, 9.0, Verdict.CLOSED) for t in (whole, math.nextafter(whole, 0)))
        assert (least_steps(just), least_steps(short)) == (steps + 1, steps)
