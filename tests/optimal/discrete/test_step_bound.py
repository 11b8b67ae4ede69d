"""A proof of K* is verified, excludes times that free controls can fly, and forged ones are rejected."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from flatgym import DISTRIBUTIONS, SCENARIOS
from flatgym.task.transition import CONTACT_SLACK
from optimal.direct.multistart import coarse_multistart, distinct_optima
from optimal.direct.shooting import WINDINGS, solve_winding
from optimal.discrete.fewest_steps import COARSE_GRID_ERROR, fewest_steps
from optimal.discrete.step_bound import least_steps, prove_steps, relaxed_scenario
from optimal.proof.branch_and_bound import ExcludedBranch
from optimal.proof.lower_bound import Proof, Verdict
from optimal.proof.programme.time_grid import HoldGrid
from optimal.proof.stages import Stage

HELD = {
    "goal": DISTRIBUTIONS["random-goal"].scenario(1_000_017),
    "hoops": DISTRIBUTIONS["random-hoops"].scenario(1_000_036),
}
"""Scenarios with a flight that is a step faster than K* if controls may change at any time."""


@cache
def fastest(name: str):
    tried = coarse_multistart(HELD.get(name) or SCENARIOS[name], WINDINGS, starts=2, slack=COARSE_GRID_ERROR)
    return distinct_optima(tried)[0][0]


@cache
def proof(name: str) -> Proof:
    steps = fewest_steps(HELD[name], time_budget=0).steps
    return prove_steps(HELD[name], fastest(name), int(steps), time_budget=60.0)


def test_fewer_steps_than_the_fewest_are_excluded():
    found = prove_steps(SCENARIOS["horizontal-6"], fastest("horizontal-6"), 61)
    assert found.verdict is Verdict.CLOSED
    assert least_steps(found) == 61
    assert found.time == 60 * 0.02
    assert found.check()


@pytest.mark.parametrize("name", HELD)
def test_held_controls_exclude_a_time_that_a_flight_with_free_controls_takes(name):
    found = proof(name)
    assert found.verdict is Verdict.CLOSED
    assert found.check()
    assert found.time == found.steps * found.scenario.dt
    assert any(isinstance(stage.grid, HoldGrid) for _, stages in found.excluded for stage in stages)
    free = [solve_winding(HELD[name], winding, tolerant=True) for winding in (-1, 0, 1)]
    assert min(shot.trajectory.duration for shot in free if shot.converged) < found.time


def replace_branch(proof: Proof, i: int, stages: tuple[Stage, ...]) -> Proof:
    """Return a proof with other stages of one branch."""
    changed = ExcludedBranch(proof.excluded[i].branch, stages)
    return replace(proof, excluded=(*proof.excluded[:i], changed, *proof.excluded[i + 1 :]))


@pytest.mark.parametrize("name", HELD)
def test_a_forged_proof_with_held_controls_is_rejected(name):
    found = proof(name)
    # The proof does not hold for controls that may change at any time, nor for another number of steps.
    assert not replace(found, steps=0).check()
    assert not replace(found, steps=found.steps + 1).check()
    assert not replace(found, steps=found.steps + 1, time=(found.steps + 1) * found.scenario.dt).check()
    assert not replace(found, scenario=replace(found.scenario, dt=found.scenario.dt / 2)).check()
    assert not replace(found, steps=2 * found.steps, scenario=replace(found.scenario, dt=found.scenario.dt / 2)).check()
    for i, (_, stages) in enumerate(found.excluded):
        assert not replace(found, excluded=found.excluded[:i] + found.excluded[i + 1 :]).check() or not stages
        needed = not replace_branch(found, i, stages[:-1]).check()  # else the stages of its parent exclude a part
        if not needed or not isinstance(grid := stages[-1].grid, HoldGrid):
            continue
        for wrong in (
            replace(grid, steps=grid.steps - grid.parts),
            replace(grid, turn=grid.turn // 2, parts=2 * grid.parts),
            replace(grid, step=grid.step / 2),
            replace(grid, rate_max=grid.rate_max / 2),
        ):
            forged = (*stages[:-1], stages[-1]._replace(grid=wrong))
            assert not replace_branch(found, i, forged).check()


@pytest.mark.parametrize("name", HELD)
def test_a_saved_proof_reads_back_and_holds(name, tmp_path):
    found = proof(name)
    again = Proof.load(found.save(tmp_path / "proof.json"))
    assert replace(again, excluded=(), common=()) == replace(found, excluded=(), common=())
    assert [each.branch for each in again.excluded] == [each.branch for each in found.excluded]
    assert again.check()


def test_an_unneeded_step_is_never_proven_needed():
    found = prove_steps(SCENARIOS["horizontal-6"], fastest("horizontal-6"), 62, time_budget=1.0)
    assert found.verdict is Verdict.BUDGET_SPENT  # a flight of 61 steps exists
    assert least_steps(found) == 61
    assert found.time < solve_winding(SCENARIOS["horizontal-6"], tolerant=True).trajectory.duration
    assert found.check()


def test_the_relaxed_scenario_includes_the_rounding_of_an_environment():
    target = SCENARIOS["high-hoop"]
    wide = relaxed_scenario(target)
    assert wide.hoops[0].diameter > target.hoops[0].diameter
    assert all(getattr(wide.tolerance, n) > getattr(target.tolerance, n) for n in ("position", "speed", "angle"))
    ground = relaxed_scenario(replace(SCENARIOS["ground-6"], ceiling=9.0))
    assert ground.floor < -CONTACT_SLACK
    assert ground.ceiling > 9.0 + CONTACT_SLACK
    assert (wide.start, wide.goal, wide.floor) == (target.start, target.goal, None)


def test_least_steps_follow_from_the_proven_time():
    found = Proof(SCENARIOS["horizontal-6"], None, 1.2, 9.0, Verdict.CLOSED)
    assert least_steps(replace(found, time=np.nextafter(1.2, 0))) == 60
    assert least_steps(replace(found, time=1.2000001)) == 61
    assert least_steps(replace(found, time=0.0)) == 1


def test_a_time_just_short_of_a_step_does_not_exclude_that_step():
    scenario = SCENARIOS["horizontal-6"]
    for steps in range(1, 200):
        whole = steps * scenario.dt
        just, short = (Proof(scenario, None, t, 9.0, Verdict.CLOSED) for t in (whole, math.nextafter(whole, 0)))
        assert (least_steps(just), least_steps(short)) == (steps + 1, steps)
