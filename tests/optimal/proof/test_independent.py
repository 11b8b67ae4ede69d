"""The second checker: it agrees with the prover on true proofs and on broken ones, and shares no code with it."""

import ast
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Quadrotor, Scenario, Tolerance
from flatgym.scenarios.reference import reference
from optimal.direct.multistart import search
from optimal.discrete.step_bound import prove_steps
from optimal.flights.projection_bound import greatest_speed, passing_windows, projection_bound
from optimal.proof import independent
from optimal.proof.branch_and_bound import ExcludedBranch, windings
from optimal.proof.branches import Branch, covered
from optimal.proof.dual import Dual
from optimal.proof.independent import chains, checker, physics, reading
from optimal.proof.independent.checker import Paths, recheck
from optimal.proof.independent.held import HeldSweeps
from optimal.proof.independent.sweeps import Sweeps
from optimal.proof.lower_bound import prove, prove_near
from optimal.proof.programme.stations import Passing, Problem, Stations
from optimal.proof.programme.time_grid import HoldGrid

TILTED = Scenario(
    "tilted", (1.0, -2.0), (4.0, 1.0), (Hoop(2.0, 0.5, 0.6, 0.9),), ceiling=1.2, quadrotor=Quadrotor(2, 24, 7)
)
PROVEN = ("horizontal-6", "ground-6", "climb", "hoop", "high-hoop", "slalom")


@cache
def proof(name):
    return prove_near(SCENARIOS[name], search(SCENARIOS[name]).shots[0], time_budget=60)


@cache
def step_proof(name):
    return prove_steps(SCENARIOS[name], search(SCENARIOS[name]).shots[0], reference(name).k_star, 60)


def second(found, tmp_path):
    return recheck(found.save(tmp_path / "proof.json"))


def test_no_module_of_the_prover_is_imported():
    for name in ("reading", "physics", "chains", "sweeps", "held", "checker"):
        file = independent.__path__[0] + f"/{name}.py"
        with open(file, encoding="utf-8") as text:
            tree = ast.parse(text.read())
        imported = [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        imported += [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
        ours = {module for module in imported if module.split(".")[0] in ("optimal", "flatgym")}
        own = {module for module in ours if module.startswith("optimal.proof.independent")}
        assert ours - own <= {"flatgym.quadrotor", "flatgym.scenarios.scenario"}


@pytest.mark.parametrize("name", PROVEN)
def test_true_proofs_of_flight_times_hold(name, tmp_path):
    assert second(proof(name), tmp_path)


@pytest.mark.parametrize("name", ["horizontal-3", "climb", "hoop"])
def test_true_proofs_of_step_counts_hold(name, tmp_path):
    found = step_proof(name)
    assert found.time == (reference(name).k_star - 1) * 0.02
    assert second(found, tmp_path)


def test_held_controls_and_windows_of_a_hoop_are_both_checked(tmp_path):
    grids = [stage.grid for _, stages in step_proof("climb").excluded for stage in stages]
    assert any(isinstance(grid, HoldGrid) for grid in grids)
    assert any(stage.hoops for _, stages in proof("high-hoop").excluded for stage in stages)
    assert proof("high-hoop").common
    found = prove(TILTED, tolerance=Tolerance(), max_gap=0.02, time_budget=20)
    assert found.kinks
    assert found.excluded
    assert second(found, tmp_path)


def test_a_proof_without_branches_is_the_projection_bound(tmp_path):
    simple = projection_bound(SCENARIOS["diagonal"])
    found = replace(proof("horizontal-6"), scenario=SCENARIOS["diagonal"], time=simple, excluded=(), common=())
    assert second(found, tmp_path)
    assert not second(replace(found, time=simple * (1 + 1e-9)), tmp_path)


@pytest.mark.parametrize("name", ["horizontal-6", "climb", "hoop"])
def test_broken_proofs_fail_in_both_checkers(name, tmp_path, generator):
    true = proof(name)
    last = next(each for each in true.excluded if not each.branch.winding)
    rest = tuple(each for each in true.excluded if each is not last)
    tilted = last.stages[-1].multipliers * generator.uniform(-1, 1, len(last.stages[-1].multipliers))
    others = (*last.stages[:-1], last.stages[-1]._replace(multipliers=np.abs(tilted)))
    broken = {
        "slower than a flight": replace(true, time=true.flown * 1.001),
        "a branch is missing": replace(true, excluded=rest) if rest else None,
        "no stage": replace(true, excluded=(*rest, ExcludedBranch(last.branch, ()))),
        "other multipliers": replace(true, excluded=(*rest, ExcludedBranch(last.branch, others))),
        "a nearer goal": replace(true, scenario=replace(true.scenario, goal=(true.scenario.goal[0] * 0.8, 3.0))),
        "a tolerance": replace(true, tolerance=Tolerance()),
        "a faster vehicle": replace(true, scenario=replace(true.scenario, quadrotor=Quadrotor(1, 22, 10))),
        "another rate": replace(true, scenario=replace(true.scenario, quadrotor=Quadrotor(1, 20, 11))),
        "held steps": replace(true, steps=60),
    }
    for what, found in broken.items():
        if found is not None:
            assert not found.check(), what
            assert not second(found, tmp_path), what


@pytest.mark.parametrize("found", [proof, step_proof])
@pytest.mark.parametrize("name", ["climb", "hoop", "slalom"])
def test_the_value_of_a_stage_is_that_of_the_prover(name, found, tmp_path):
    """Both compute F of the same stage, by other means."""
    found = found(name)
    claimed = reading.read(found.save(tmp_path / "proof.json"))
    problem = Problem(found.scenario, found.tolerance, found.time, found.kinks, found.steps)
    known = chains.Known(
        physics.possible_windows(found.scenario, found.time, found.tolerance),
        np.tile([0.0, found.time], (max(len(problem.hoops) - 1, 0), 1)),
    )
    assert not found.common
    for (branch, stages), own in zip(found.excluded, claimed.branches, strict=True):
        stage = stages[0]
        dual = Dual(problem, stage.grid, branch, stage.hoops, Passing.possible(problem).of(stage.hoops))
        theirs = chains.Chains(claimed, own.stages[0], known)
        sweeps = (HeldSweeps if own.stages[0].parts else Sweeps)(theirs, own)
        assert sweeps.possible == dual.possible
        if dual.possible:
            pairs = [theirs.pairs(i) for i in range(len(stage.hoops) + 1)]
            paths = [Paths(theirs, sweeps, pairs, programme) for programme in sweeps.programmes]
            value = np.mean([each.best for each in paths]) + theirs.shared
            assert value == pytest.approx(dual.evaluate(stage.multipliers).value, rel=1e-6, abs=1e-9)
            # The best chain passes each segment somewhere, so the greatest value through its pairs is the best one.
            for each in paths:
                assert [each.through(i).max() for i in range(len(pairs))] == pytest.approx([each.best] * len(pairs))


def test_physics_agrees_with_the_prover(generator):
    for _ in range(20):
        low, gravity = generator.uniform(0.5, 5), 9.81
        vehicle = Quadrotor(low, generator.uniform(12, 30), generator.uniform(3, 12), gravity)
        hoops = tuple(Hoop(*generator.uniform(-4, 4, 2), 0.6, generator.uniform(-3, 3)) for _ in range(3))
        task = Scenario("any", (0.0, 0.0), tuple(generator.uniform(2, 5, 2)), hoops, quadrotor=vehicle)
        for tolerance in (None, Tolerance()):
            assert physics.least_flight_time(task, tolerance) == pytest.approx(projection_bound(task, tolerance))
            shares = np.array(passing_windows(task, 5.0, tolerance))
            assert physics.possible_windows(task, 5.0, tolerance) == pytest.approx(5.0 * shares)
            stations = Stations(Problem(task, tolerance, 5.0), (0, 1, 2))
            places, sizes = chains.gaps(task, (0, 1, 2))
            far, near, _ = chains.distances(places, sizes, tolerance.position if tolerance else 0.0)
            assert places == pytest.approx(stations.places)
            assert (far, near) == (pytest.approx(stations.far, abs=1e-6), pytest.approx(stations.near, abs=1e-6))
        ahead, back, before, after = generator.uniform(1, 30, 4)
        limits = tuple(generator.uniform(1, 3, 3))
        expected = greatest_speed((ahead, back), (0.0, before), (0.0, after), limits)
        assert physics.speed_bound(ahead, back, before, after, *limits) == pytest.approx(expected, rel=1e-6)


def test_coverage_agrees_with_the_prover(generator):
    """Random boxes that are cut from a whole, of which one may be missing."""
    task, agree = SCENARIOS["hoop"], []
    for _ in range(60):
        boxes = [Branch(winding) for winding in windings(Problem(task, None, 1.0))]
        for _ in range(4):
            box = boxes.pop(int(generator.integers(len(boxes))))
            cut = float(np.round(generator.uniform(0, 1), 1))
            boxes += box.split_tilt(0.5, cut) if generator.random() < 0.5 else box.split_passing(0, cut)
        if generator.random() < 0.5:
            boxes.pop(int(generator.integers(len(boxes))))
        own = tuple(reading.Branch(box.winding, tuple(box.held), tuple(box.passing), ()) for box in boxes)
        claimed = reading.Claimed(task, None, 1.0, (), 0, (), own)
        agree.append(reading.all_covered(claimed))
        assert agree[-1] == covered(boxes, range(-1, 2))
    assert len(set(agree)) == 2


def test_more_than_it_can_check_is_said(tmp_path, monkeypatch):
    path = proof("hoop").save(tmp_path / "proof.json")
    monkeypatch.setattr(checker, "MOST_WORK", 1e6)
    with pytest.raises(reading.TooLarge, match="its windows are too wide, or its grids too fine"):
        recheck(path)
    monkeypatch.setattr(reading, "MOST_PIECES", 1)
    parts = [Branch(winding) for winding in range(-3, 4) if winding] + Branch(0).split_tilt(0.5, 1.0)
    split = replace(proof("climb"), excluded=tuple(ExcludedBranch(part, ()) for part in parts))
    with pytest.raises(reading.TooLarge, match="its branches are too many"):
        recheck(split.save(path))
    impossible = replace(proof("hoop"), time=np.inf, excluded=())
    with pytest.raises(reading.TooLarge, match="no flight exists"):
        recheck(impossible.save(path))


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": 1, "proof": {}}', '{"schema": 2, "proof": {"time": 3}}'])
def test_a_file_that_is_no_proof_is_refused(tmp_path, text):
    path = tmp_path / "proof.json"
    path.write_text(text)
    with pytest.raises(ValueError, match="not a proof"):
        recheck(path)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"turn": 2}, "not one of this vehicle"),
        ({"steps": 50}, "too coarse or too short"),
        ({"stride": 7}, "not in order"),
        ({"hoops": (1,)}, "hoops that the scenario has not"),
        ({"hoops": (0, 0)}, "not in order"),
        ({"duration": 0.5}, "shorter than the excluded time"),
        ({"parts": 2, "step": 0.02}, "not of the environment's steps"),
        ({"multipliers": np.ones(3)}, "too few, too many, infinite or negative"),
        ({"multipliers": -np.ones(8)}, "too few, too many, infinite or negative"),
    ],
)
def test_a_stage_of_another_problem_is_invalid(tmp_path, change, reason):
    claimed = reading.read(proof("hoop").save(tmp_path / "proof.json"))
    (branch,) = claimed.branches[:1]
    stage = replace(next(each for each in branch.stages if each.hoops), **change)
    windows = physics.possible_windows(claimed.scenario, claimed.time, None)
    with pytest.raises(chains.Invalid, match=reason):
        chains.Chains(claimed, stage, chains.Known(windows, np.zeros((0, 2))))
