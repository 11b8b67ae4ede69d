"""The benchmark at small size: finished cells are skipped, cells state their episodes, failures stay in their cell."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from agents.evaluation.scores import FasterThanOptimal
from experiments.benchmark import run
from experiments.benchmark.conditions import CONDITIONS
from experiments.benchmark.run import run_cell
from experiments.benchmark.suite import Cell
from experiments.cli import app
from experiments.publishing.learners import learners as table
from experiments.recipes import run_spec
from experiments.recipes.registry import EXPERTS
from flatgym import OUTCOMES, SCENARIOS
from flatgym.scenarios.reference import reference
from flatgym.task.rollout import fly_actions

SMOKE = replace(
    run_spec.SMOKE,
    ppo_steps=(100, 100, 100, 100),
    finetuning_steps=100,
    finetuning_s=30.0,
    gradient_steps=(5, 5),
    expert_rollouts=2,
)
ASKED = ("--only", "hoop/bc-ppo", "--only", "hoop/open-loop", "--only", "hoop/expert", "--only", "hoop/pd")


def flatquad_study(folder, *arguments):
    """Run `flatquad benchmark --study --quick` as a shell would, at the size of this test; return its exit status."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_spec, "SMOKE", SMOKE)
        options = ("--study", "--quick", "--jobs", "1", "--out", str(folder))
        patch.setattr(sys, "argv", ["flatquad", "benchmark", *options, *arguments])
        with pytest.raises(SystemExit) as end:
            app.main()
    return end.value.code


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """The results file of a small study."""
    folder = tmp_path_factory.mktemp("study")
    assert flatquad_study(folder, "--seeds", "1", *ASKED) == 0
    return folder / "learners-quick.json"


def test_an_unknown_cell_ends_the_command(capsys, tmp_path):
    assert flatquad_study(tmp_path, "--only", "hop/ppo") == 2
    assert "unknown cell 'hop/ppo'" in capsys.readouterr().err


def test_every_cell_states_its_episodes(study):
    results = json.loads(study.read_text())
    assert [cell["agent"] for cell in results["cells"]] == ["bc", "bc-ppo", "expert", "open-loop", "pd"]
    assert results["smoke"]
    assert results["k_star"] == {"hoop": [reference("hoop").k_star] * SMOKE.disturbed_episodes}
    for cell in results["cells"]:
        assert list(cell["episodes"]) == list(CONDITIONS)
        flown = fly_actions(SCENARIOS["hoop"], np.array(cell["actions"], dtype=np.float32))
        assert [OUTCOMES[flown[-1].outcome[0]]] == list(cell["episodes"]["nominal"]["outcomes"])
        for name, flown in cell["episodes"].items():
            assert len(flown["steps"]) == (1 if name == "nominal" else SMOKE.disturbed_episodes)
            assert flown["outcomes"].get("goal", 0) == sum(steps is not None for steps in flown["steps"])
    nominal = {cell["agent"]: cell["episodes"]["nominal"]["steps"] for cell in results["cells"]}
    assert nominal["expert"] == nominal["open-loop"] == results["k_star"]["hoop"][:1]


def test_the_cost_of_a_prerequisite_is_included(study):
    by_name = {cell["agent"]: cell for cell in json.loads(study.read_text())["cells"]}
    first, then = by_name["bc"], by_name["bc-ppo"]
    assert then["expert_labels"] == first["expert_labels"] > 0
    assert then["training_s"] >= first["training_s"]
    assert then["curve"][: len(first["curve"])] == first["curve"]
    assert then["env_steps"] > first["env_steps"] == 0


def test_the_tables_can_be_written_from_the_results(study):
    assert "numbers mean nothing" in " ".join(table(json.loads(study.read_text())).split())


def test_finished_cells_are_skipped(study, monkeypatch):
    folder = study.with_suffix("")
    before = {path: path.read_bytes() for path in folder.glob("hoop-*")}
    monkeypatch.setattr(run, "run_cell", lambda *_: pytest.fail("a finished cell ran again"))
    assert flatquad_study(study.parent, "--seeds", "1", *ASKED) == 0
    assert {path: path.read_bytes() for path in folder.glob("hoop-*")} == before


def test_a_failure_is_reported_and_the_others_continue(tmp_path, monkeypatch, capsys):
    def broken(_):
        raise RuntimeError("no wind tunnel")

    monkeypatch.setitem(EXPERTS, "expert", broken)
    out, cells = tmp_path / "learners-quick.json", ("--only", "hoop/expert", "--only", "hoop/pd")
    assert flatquad_study(tmp_path, *cells) == 1
    assert "hoop/expert, seed 0: RuntimeError: no wind tunnel" in capsys.readouterr().out
    broken, sound = json.loads(out.read_text())["cells"]
    assert (broken["agent"], broken["error"], broken["episodes"]) == ("expert", "RuntimeError: no wind tunnel", {})
    assert sound["agent"] == "pd"
    monkeypatch.undo()
    assert flatquad_study(tmp_path, *cells) == 0
    assert not any(cell.get("error") for cell in json.loads(out.read_text())["cells"])


def test_an_episode_faster_than_optimal_stores_its_evidence(tmp_path, monkeypatch):
    actions = np.zeros((3, 2), dtype=np.float32)

    def fast(*_):
        raise FasterThanOptimal(SCENARIOS["hoop"], 70, actions, np.zeros((4, 5)))

    monkeypatch.setattr(run, "fly_conditions", fast)
    cell = Cell("hoop", "pd", 0)
    run_cell(cell, tmp_path, SMOKE, EXPERTS["pd"])
    assert "was flown in 3 steps, fewer than K* = 70" in cell.read(tmp_path)["error"]
    evidence = json.loads((tmp_path / "hoop-pd-0.faster.json").read_text())
    assert (evidence["actions"], evidence["k_star"]) == (actions.tolist(), 70)
