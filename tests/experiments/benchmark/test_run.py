"""The benchmark at small size: cells are made once, say what was flown, and one failure ends no other."""

import json
from dataclasses import replace

import numpy as np
import pytest

from agents.controllers.tracking import OpenLoop
from agents.evaluation.rollouts import fly
from agents.evaluation.scores import FasterThanOptimal
from agents.imitation.cloning import student
from agents.imitation.dataset_aggregation import DaggerConfig
from experiments.benchmark import run
from experiments.benchmark import study as command
from experiments.benchmark.conditions import CONDITIONS
from experiments.benchmark.run import make
from experiments.benchmark.study import main
from experiments.benchmark.suite import SUITES, Cell, can_fly
from experiments.files import write_json
from experiments.publishing.learners import learners as table
from experiments.recipes import imitation, lesson
from experiments.recipes.baselines import PolicyPerVehicle
from experiments.recipes.lesson import RunSpec
from experiments.recipes.margins import narrower, teacher
from experiments.recipes.plans import plans
from experiments.recipes.registry import EXPERTS, LEARNERS, ONLY_SCENARIOS
from flatgym import DISTRIBUTIONS, OUTCOMES, SCENARIOS
from flatgym.scenarios.reference import EVALUATION_SEED, drawn_k_star, reference
from flatgym.task.rollout import fly_actions

SMOKE = replace(
    lesson.SMOKE, planned=3, ppo_steps=100, tuning_steps=100, tuning_s=30.0, gradient_steps=(5, 5), shown=2, goals=3
)
ASKED = ("hoop/bc-ppo", "hoop/tape", "hoop/expert", "hoop/pd")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A small study that has run: the folder of its results, and what `main` returned."""
    out = tmp_path_factory.mktemp("study") / "mine.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "SMOKE", SMOKE)
        code = main(["--quick", "--jobs", "1", "--seeds", "1", "--out", str(out), "--only", *ASKED])
    assert code == 0
    return out


@pytest.fixture(scope="module")
def lesson(tmp_path_factory):
    """A lesson on random goals whose flights are planned in this process."""
    folder = tmp_path_factory.mktemp("lesson")
    for first, count in ((0, SMOKE.planned), (EVALUATION_SEED, SMOKE.disturbed)):
        write_json(folder / f"planned-random-goal-{first}-{first + count}.json", {"planning_s": 1.5})
    return RunSpec("random-goal", 0, folder, SMOKE)


def test_suites_have_every_agent_on_every_problem_it_can_fly():
    for suite in (SUITES["study"], SUITES["full"]):
        found = suite.cells()
        assert len(set(found)) == len(found)
        for problem in suite.agents:
            for agent in LEARNERS:
                assert [cell.seed for cell in found if (cell.problem, cell.agent) == (problem, agent)] == [0, 1, 2]
            drawn = problem in DISTRIBUTIONS
            left_out = ({*ONLY_SCENARIOS} if drawn else set()) | ({"pretrained"} if suite.name == "study" else set())
            assert {cell.agent for cell in found if cell.problem == problem} == {*LEARNERS, *EXPERTS} - left_out
    assert set(SUITES["full"].agents) == {*SCENARIOS, *DISTRIBUTIONS}
    for problem, agents in SUITES["quick"].agents.items():
        assert all(can_fly(agent, problem) for agent in agents)


def test_what_one_begins_with_comes_with_it():
    suite = replace(SUITES["study"], seeds=1)
    assert [cell.agent for cell in suite.cells(["hoop/bc-ppo"])] == ["bc", "bc-ppo"]
    assert suite.cells(["hoop", "random-goal"]) == suite.cells()


def test_unknown_cells_are_named(capsys):
    with pytest.raises(ValueError, match=r"unknown cells hop/ppo; known: hoop, hoop/bc, hoop/bc-ppo"):
        SUITES["study"].cells(["hop/ppo"])
    with pytest.raises(SystemExit, match="2"):
        main(["--only", "hop/ppo"])
    assert "unknown cells hop/ppo" in capsys.readouterr().err


def test_every_cell_says_what_was_flown(study):
    results = json.loads(study.read_text())
    assert [cell["agent"] for cell in results["cells"]] == ["bc", "bc-ppo", "expert", "tape", "pd"]
    assert results["quick"]
    for cell in results["cells"]:
        assert list(cell["flights"]) == list(CONDITIONS)
        flown = fly_actions(SCENARIOS["hoop"], np.array(cell["actions"], dtype=np.float32))
        assert [OUTCOMES[flown[-1].outcome[0]]] == list(cell["flights"]["calm"]["outcomes"])
        for name, flown in cell["flights"].items():
            assert len(flown["steps"]) == (1 if name == "calm" else SMOKE.disturbed)
            assert flown["outcomes"].get("goal", 0) == sum(steps is not None for steps in flown["steps"])
    calm = {cell["agent"]: cell["flights"]["calm"]["steps"] for cell in results["cells"]}
    assert calm["expert"] == calm["tape"] == results["k_star"]["hoop"][:1]


def test_what_one_begins_with_is_paid_for(study):
    by_name = {cell["agent"]: cell for cell in json.loads(study.read_text())["cells"]}
    first, then = by_name["bc"], by_name["bc-ppo"]
    assert then["expert_steps"] == first["expert_steps"] > 0
    assert then["wall_time_s"] >= first["wall_time_s"]
    assert then["curve"][: len(first["curve"])] == first["curve"]
    assert then["env_steps"] > first["env_steps"] == 0


def test_the_tables_can_be_written_from_it(study):
    assert "numbers mean nothing" in " ".join(table(json.loads(study.read_text())).split())


def test_what_is_done_is_not_done_again(study, monkeypatch):
    folder = study.with_suffix("")
    before = {path: path.read_bytes() for path in folder.glob("hoop-*")}
    monkeypatch.setattr(run, "make", lambda *_: pytest.fail("a cell was made again"))
    monkeypatch.setattr(command, "SMOKE", SMOKE)
    assert main(["--quick", "--jobs", "1", "--seeds", "1", "--out", str(study), "--only", *ASKED]) == 0
    assert {path: path.read_bytes() for path in folder.glob("hoop-*")} == before


def test_a_failure_is_told_and_ends_no_other(tmp_path, monkeypatch, capsys):
    def broken(_):
        raise RuntimeError("no wind tunnel")

    monkeypatch.setitem(EXPERTS, "expert", broken)
    monkeypatch.setattr(command, "SMOKE", SMOKE)
    out = tmp_path / "mine.json"
    assert main(["--quick", "--jobs", "1", "--out", str(out), "--only", "hoop/expert", "hoop/pd"]) == 1
    assert "hoop/expert/0: RuntimeError: no wind tunnel" in capsys.readouterr().out
    broken, sound = json.loads(out.read_text())["cells"]
    assert (broken["agent"], broken["error"], broken["flights"]) == ("expert", "RuntimeError: no wind tunnel", {})
    assert sound["agent"] == "pd"
    monkeypatch.undo()
    monkeypatch.setattr(command, "SMOKE", SMOKE)
    assert main(["--quick", "--jobs", "1", "--out", str(out), "--only", "hoop/expert", "hoop/pd"]) == 0
    assert not any(cell.get("error") for cell in json.loads(out.read_text())["cells"])


def test_a_flight_faster_than_optimal_leaves_its_evidence(tmp_path, monkeypatch):
    actions = np.zeros((3, 2), dtype=np.float32)

    def fast(*_):
        raise FasterThanOptimal(SCENARIOS["hoop"], 70, actions, np.zeros((4, 5)))

    monkeypatch.setattr(run, "flown", fast)
    cell = Cell("hoop", "pd", 0)
    make(cell, tmp_path, SMOKE)
    assert "was flown in 3 steps, fewer than K* = 70" in cell.read(tmp_path)["error"]
    evidence = json.loads((tmp_path / "hoop-pd-0.faster.json").read_text())
    assert (evidence["actions"], evidence["k_star"]) == (actions.tolist(), 70)


def test_the_flight_that_is_taught_takes_no_step_more_and_clears_the_rim():
    flight, known = teacher(SCENARIOS["hoop"]), reference("hoop")
    assert flight.steps == known.k_star
    for scenario in (SCENARIOS["hoop"], narrower(SCENARIOS["hoop"])):
        assert OUTCOMES[fly_actions(scenario, flight.actions)[-1].outcome[0]] == "goal"


def test_each_flies_his_own_flight(lesson):
    flights, seconds = plans(lesson, EVALUATION_SEED, SMOKE.disturbed)
    assert seconds == 1.5
    flown = fly(
        PolicyPerVehicle([OpenLoop(flight) for flight in flights]), "random-goal", len(flights), EVALUATION_SEED
    )
    k_star = drawn_k_star("random-goal", EVALUATION_SEED + np.arange(len(flights))).k_star
    assert flown.outcomes == ("goal",) * len(flights)
    assert flown.steps.tolist() == k_star.tolist()


@pytest.mark.parametrize("problem", list(SUITES["study"].agents))
def test_steps_flown_and_shown_are_counted(lesson, problem):
    taught = replace(lesson, problem=problem)
    adviser, _ = imitation.oracle_for(taught, 2)
    shown = adviser(None, 0)
    mirrors = 2 if problem == "random-goal" else 1
    assert mirrors * adviser.expert_steps == len(shown.actions)
    assert adviser.env_steps == 0
    learner = student(DaggerConfig(scenario=problem, width=8, depth=1))
    before, advice = adviser.expert_steps, adviser(learner, 1)
    if problem == "random-goal":
        seed = SMOKE.corrected % (SMOKE.planned - SMOKE.corrected)
        alone = fly(learner, DISTRIBUTIONS[problem], SMOKE.corrected, seed).steps.sum()
        assert alone < adviser.env_steps <= alone + SMOKE.followed * DISTRIBUTIONS[problem].max_steps
        assert 0 < 2 * (adviser.expert_steps - before) < len(advice.actions)  # mirrored, and plans count repeatedly
    else:
        assert adviser.env_steps >= adviser.expert_steps - before == len(advice.actions)
    assert (adviser.env_steps, adviser.expert_steps - before) == (advice.flown, advice.asked)
