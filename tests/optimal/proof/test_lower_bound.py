"""A proof is close to the optimum, never above a flight, verifiable, and invalid if any part is removed."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Quadrotor, Scenario, Tolerance
from optimal.direct.multistart import search
from optimal.direct.shooting import solve_coarse, solve_winding
from optimal.flights.projection_bound import projection_bound
from optimal.proof.branch_and_bound import BranchAndBound, ExcludedBranch
from optimal.proof.branches import Branch
from optimal.proof.lower_bound import LEAST_GAP_STEP, Proof, Verdict, faster_flight, lower_bound, prove, prove_near

CLOSED = ("horizontal-3", "horizontal-6", "horizontal-9", "horizontal-12", "horizontal-15", "ground-6", "diagonal",
          "climb", "drop", "hoop", "high-hoop")  # fmt: skip
PRINTED = {
    "horizontal-3": 0.8902,
    "horizontal-6": 1.223,
    "horizontal-9": 1.478,
    "horizontal-12": 1.694,
    "horizontal-15": 1.885,
    "ground-6": 1.227,
    "diagonal": 1.289,
}
"""Times of the paper's table that are impossible [s]."""
FORGED = ("horizontal-6", "climb", "high-hoop", "ground-6")
VEHICLES = (Quadrotor(), Quadrotor(thrust_min=0.5, thrust_max=30, rate_max=5), Quadrotor(3, 14, 20))


@cache
def fastest(name):
    return search(SCENARIOS[name]).shots[0]


@cache
def proof(name: str) -> Proof:
    return prove_near(SCENARIOS[name], fastest(name))


@pytest.mark.parametrize("name", CLOSED)
def test_named_scenarios_are_proven_to_a_thousandth_and_the_proof_is_verified(name):
    found = proof(name)
    assert found.verdict is Verdict.CLOSED
    assert found.reason == ""
    assert 0 < found.gap <= 1e-3
    assert projection_bound(SCENARIOS[name]) < found.time < found.flown
    assert found.flown == fastest(name).trajectory.duration
    assert found.check()
    assert found.evaluations >= 1


@pytest.mark.parametrize("name", PRINTED)
def test_impossible_printed_times_are_below_the_bound(name):
    assert PRINTED[name] < proof(name).time


def test_the_public_functions_agree():
    assert lower_bound("horizontal-6") == proof("horizontal-6").time
    again = prove("horizontal-6")
    alike = {"wall_time": 0.0, "excluded": (), "common": ()}
    assert replace(again, **alike) == replace(proof("horizontal-6"), **alike)


# Every part of a proof is needed.


def replaced(found: Proof, i: int, **changes) -> Proof:
    """Return a proof with other values in the last stage of branch i."""
    branch, stages = found.excluded[i]
    other = ExcludedBranch(branch, (*stages[:-1], stages[-1]._replace(**changes)))
    return replace(found, excluded=(*found.excluded[:i], other, *found.excluded[i + 1 :]))


@pytest.mark.parametrize("name", FORGED)
def test_a_proof_without_one_of_its_branches_or_stages_is_invalid(name):
    found = proof(name)
    for i, (branch, stages) in enumerate(found.excluded):
        # Windings that take longer than the duration may be missing.
        spare = abs(branch.winding or 0) * 2 * math.pi > found.scenario.quadrotor.rate_max * found.time
        assert replace(found, excluded=found.excluded[:i] + found.excluded[i + 1 :]).check() is False or spare
        less = ExcludedBranch(branch, stages[:-1])
        assert not replace(found, excluded=(*found.excluded[:i], less, *found.excluded[i + 1 :])).check()
    assert not replace(found, excluded=()).check()


@pytest.mark.parametrize("name", FORGED)
def test_a_proof_with_other_multipliers_is_invalid(name, generator):
    found = proof(name)
    for i, (branch, stages) in enumerate(found.excluded):
        y = stages[-1].multipliers
        # F is convex and F(0) = 0, so F(y) < 0 implies F(-y) > 0.
        opposite = np.append(-y[:-2], y[-2:])
        random = np.append(generator.normal(size=len(y) - 2), y[-2:])
        for wrong in (0 * y, np.nan * y, np.append(y[:-2], -y[-2:]), y[:-1], opposite, random):
            forged = replaced(found, i, multipliers=wrong)
            spare = abs(branch.winding or 0) * 2 * math.pi > found.scenario.quadrotor.rate_max * found.time
            assert not forged.check() or spare


@pytest.mark.parametrize("name", FORGED)
def test_a_proof_with_a_shorter_grid_or_of_another_rate_is_invalid(name):
    found = proof(name)
    grid = found.excluded[0].stages[-1].grid
    assert not replaced(found, 0, grid=replace(grid, steps=grid.steps - 1)).check()
    assert not replaced(found, 0, grid=replace(grid, rate_max=5.0)).check()


def test_a_proof_is_invalid_for_a_greater_time_or_an_easier_task():
    found = proof("hoop")
    assert not replace(found, time=found.time * 1.0005).check()
    hoop, start = found.scenario.hoops[0], found.scenario
    for easier in (
        replace(start, hoops=()),
        replace(start, goal=(4.8, 4.8)),
        replace(start, quadrotor=Quadrotor(thrust_max=20.5)),
        replace(start, quadrotor=Quadrotor(rate_max=11.0)),
        replace(start, quadrotor=Quadrotor(rate_max=10.0, gravity=9.5)),
    ):
        assert not replace(found, scenario=easier).check()
    assert not replace(proof("high-hoop"), scenario=replace(SCENARIOS["high-hoop"], hoops=(hoop,))).check()
    assert not replace(found, tolerance=Tolerance()).check()


def test_the_verdict_impossible_is_checked():
    assert not Proof(SCENARIOS["hoop"], None, math.inf, math.inf, Verdict.IMPOSSIBLE).check()


def test_held_tilts_are_part_of_the_proof():
    found = proof("climb")
    for i, (branch, stages) in enumerate(found.excluded):
        if branch.held:
            free = ExcludedBranch(Branch(branch.winding), stages)
            assert not replace(found, excluded=(*found.excluded[:i], free, *found.excluded[i + 1 :])).check()


@pytest.mark.parametrize("name", [*FORGED, "hoop"])
def test_a_saved_proof_reads_back_to_the_bit(name, tmp_path):
    found = proof(name)
    again = Proof.load(found.save(tmp_path / "proof.json"))
    assert replace(again, excluded=(), common=()) == replace(found, excluded=(), common=())
    for one, other in zip(again.excluded, found.excluded, strict=True):
        assert one.branch == other.branch
        for stage, twin in zip(one.stages, other.stages, strict=True):
            assert (stage.grid, stage.hoops) == (twin.grid, twin.hoops)
            assert np.array_equal(stage.multipliers, twin.multipliers)
    assert again.check()


def test_a_file_that_is_no_proof_is_refused(tmp_path):
    for text in ("", "{}", '{"schema": 9}', '{"schema": 1, "proof": {}}'):
        (tmp_path / "proof.json").write_text(text)
        with pytest.raises(ValueError, match="not a proof"):
            Proof.load(tmp_path / "proof.json")


# Never above a flight.


def random_goal(generator: np.random.Generator) -> Scenario:
    """Return a scenario with a goal in the square of half-width 10 m around the start, at least 0.5 m away."""
    while np.hypot(*(goal := generator.uniform(-10.0, 10.0, 2))) < 0.5:
        pass
    return Scenario("goal", (0.0, 0.0), tuple(goal.tolist()))


@pytest.mark.parametrize("vehicle", VEHICLES, ids=["default", "slow", "agile"])
def test_no_flight_found_from_any_start_is_faster_than_the_bound(vehicle):
    generator = np.random.default_rng(11)
    for _ in range(10):
        goal = replace(random_goal(generator), quadrotor=vehicle)
        found = search(goal, starts=2).shots[0]
        near = prove_near(goal, found, max_gap=0.01)
        assert near.verdict is Verdict.CLOSED
        others = [solve_coarse(goal, winding, generator=generator) for winding in (0, 1, -1)]
        shots = sorted((s for s in (found, *others) if s.converged), key=lambda shot: shot.trajectory.duration)
        known = shots[0].trajectory.duration
        assert projection_bound(goal) <= near.time < known <= 1.01 * near.time
        # A slow flight is a poor start with a large range of unproven times.
        poor = prove_near(goal, shots[-1], max_gap=0.01, time_budget=0.1)
        assert projection_bound(goal) <= poor.time < known


def test_a_flight_that_is_not_the_fastest_never_proves_itself():
    slow = solve_winding(SCENARIOS["climb"], 0)
    assert slow.trajectory.duration > 1.005 * fastest("climb").trajectory.duration
    found = prove_near(SCENARIOS["climb"], slow, time_budget=0.3)
    assert found.verdict is Verdict.BUDGET_SPENT
    assert found.time < fastest("climb").trajectory.duration
    assert found.check()


def mirrored(scenario: Scenario) -> Scenario:
    hoops = tuple(replace(hoop, x=-hoop.x, angle=math.pi - hoop.angle) for hoop in scenario.hoops)
    return replace(scenario, goal=(-scenario.goal[0], scenario.goal[1]), hoops=hoops)


@pytest.mark.parametrize("name", ["diagonal", "ground-6", "hoop", "high-hoop"])
def test_the_mirrored_task_has_the_same_bound(name):
    assert lower_bound(mirrored(SCENARIOS[name])) == pytest.approx(proof(name).time, rel=1e-3)


def test_a_longer_displacement_has_a_larger_bound():
    bounds = [proof(f"horizontal-{way}").time for way in (3, 6, 9, 12, 15)]
    assert (np.diff(bounds) > 0.1).all()


def test_heights_and_hoops_raise_the_bound():
    for free, bound in (("horizontal-6", "ground-6"), ("diagonal", "hoop"), ("hoop", "high-hoop")):
        assert proof(free).time < proof(bound).flown
        assert proof(bound).time > proof(free).time * (1 - 1e-3)
    assert proof("high-hoop").time > 1.05 * proof("hoop").flown


def test_within_a_tolerance_flights_may_be_faster():
    # The gap is relative to the flight from rest to rest, so it includes what the tolerance saves.
    found = prove("horizontal-6", tolerance=Tolerance(), max_gap=0.03)
    tolerant = solve_winding(SCENARIOS["horizontal-6"], tolerant=True).trajectory.duration
    assert found.verdict is Verdict.CLOSED
    assert projection_bound(SCENARIOS["horizontal-6"], Tolerance()) < found.time < tolerant < 1.01 * found.time
    assert found.check()
    assert not replace(found, tolerance=Tolerance(0.2, 0.4, 0.2)).check()


def test_a_hoop_that_brings_the_flight_back_to_its_start_is_bounded_too():
    there = Scenario("there-and-back", (0, 0), (0, 0), (Hoop(3, 0, 1.0),))
    found = prove(there, max_gap=0.02)
    assert projection_bound(there) == 0.0
    assert found.verdict is Verdict.CLOSED
    assert found.gap <= 0.02
    assert found.check()


# Limits of a proof.


def test_the_projection_bound_is_used_if_it_is_larger():
    found = prove_near(SCENARIOS["diagonal"], fastest("diagonal"), max_gap=0.5)
    assert found.time == projection_bound(SCENARIOS["diagonal"]) > found.flown / 1.5
    assert found.verdict is Verdict.CLOSED
    assert found.check()


def test_a_spent_budget_keeps_what_was_proven():
    nothing = prove_near(SCENARIOS["hoop"], fastest("hoop"), time_budget=1e-9)
    assert nothing.verdict is Verdict.BUDGET_SPENT
    assert nothing.time == projection_bound(SCENARIOS["hoop"])
    assert not nothing.excluded
    assert nothing.check()
    assert not replace(nothing, time=nothing.time * 1.001).check()
    assert proof("climb").excluded  # kernels are compiled, outside the budget
    little = prove_near(SCENARIOS["climb"], fastest("climb"), max_gap=1e-6, time_budget=0.3)
    assert little.verdict is Verdict.BUDGET_SPENT
    assert little.gap > 1e-6
    assert projection_bound(SCENARIOS["climb"]) < little.time < fastest("climb").trajectory.duration
    assert little.check()


def test_a_duration_that_takes_too_long_gives_way_to_one_between_it_and_the_bound(monkeypatch):
    """Gaps below 0.3 % take too long here. The gap that is proven is at most LEAST_GAP_STEP times as large."""
    exclude, hardest = BranchAndBound.exclude, fastest("climb").trajectory.duration / 1.003
    monkeypatch.setattr(
        BranchAndBound, "exclude", lambda self, *args: exclude(self, *args) if args[0].duration < hardest else None
    )
    found = prove_near(SCENARIOS["climb"], fastest("climb"))
    assert found.verdict is Verdict.BUDGET_SPENT
    assert 0.003 < found.gap < 0.003 * LEAST_GAP_STEP
    assert found.check()


def test_an_impossible_scenario_has_an_infinite_bound():
    flat = replace(SCENARIOS["ground-6"], hoops=(Hoop(3.0, 0.0, 1.0, -math.pi / 2),))
    found = prove(flat)
    assert found.time == found.flown == found.gap == lower_bound(flat) == math.inf
    assert found.verdict is Verdict.IMPOSSIBLE
    assert "against the floor" in found.reason
    assert found.check()


def test_the_projection_bound_is_used_if_no_flight_is_known():
    far = replace(SCENARIOS["diagonal"], goal=(4000.0, 0.0), time_limit=1000.0)
    found = prove(far)
    assert found.verdict is Verdict.NO_FLIGHT
    assert "too far" in found.reason
    assert found.time == projection_bound(far) > 20
    assert found.flown == found.gap == math.inf
    assert found.check()


@pytest.mark.parametrize("name", ["max_gap", "time_budget"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_gaps_and_budgets_must_be_positive(name, value):
    with pytest.raises(ValueError, match=f"{name} must be positive, got {value!r}"):
        prove("hoop", **{name: value})
    with pytest.raises(ValueError, match=f"{name} must be positive, got {value!r}"):
        lower_bound("hoop", **{name: value})
    with pytest.raises(ValueError, match=f"{name} must be positive, got {value!r}"):
        prove_near(SCENARIOS["hoop"], fastest("hoop"), **{name: value})


def test_unknown_scenarios_are_named():
    with pytest.raises(ValueError, match=r"unknown scenario 'hop'.*did you mean 'hoop'"):
        prove("hop")


def test_an_unfinished_proof_names_chains_near_which_a_faster_flight_is_found():
    """A proof that starts from a slow flight stops at a chain that leads to the fast one."""
    scenario, fast = SCENARIOS["high-hoop"], fastest("high-hoop")
    slow = min(
        (solve_winding(scenario, winding) for winding in (-1, 0, 1) if winding != fast.winding),
        key=lambda shot: shot.trajectory.duration if shot.converged else math.inf,
    )
    assert slow.trajectory.duration > 1.01 * fast.trajectory.duration
    unfinished = prove_near(scenario, slow, max_gap=1e-3, time_budget=1.0)
    assert unfinished.verdict is Verdict.BUDGET_SPENT
    assert unfinished.time <= fast.trajectory.duration
    found = faster_flight(scenario, unfinished)
    assert found.trajectory.duration == pytest.approx(fast.trajectory.duration, rel=1e-3)
    assert faster_flight(scenario, proof("high-hoop")) is None
