"""Suites: every agent flies every problem it can fly, and cells are selected by name."""

import json
from dataclasses import replace

import pytest

from agents import policies
from experiments.benchmark.results import merge, select_problem
from experiments.benchmark.suite import COMPARED, SUITES, can_fly
from experiments.benchmark.tasks import own_tasks, scenarios_of
from experiments.recipes.registry import COMPARED_ON_FEW, EXPERTS, LEARNERS, SCENARIO_ONLY
from flatgym import DISTRIBUTIONS, SCENARIOS, Scenario
from flatgym.scenarios import catalogue
from flatgym.task.rollout import fly_actions
from flatgym.task.scene import GOAL


def test_suites_have_every_agent_on_every_problem_it_can_fly():
    for suite in (SUITES["study"], SUITES["full"]):
        cells = suite.cells()
        assert len(set(cells)) == len(cells)
        for problem in suite.agents:
            few = suite.name == "full" and problem not in COMPARED
            for agent in LEARNERS.keys() - (COMPARED_ON_FEW if few else ()):
                assert [cell.seed for cell in cells if (cell.problem, cell.agent) == (problem, agent)] == [0, 1, 2]
            left_out = ({*SCENARIO_ONLY} if problem in DISTRIBUTIONS else set()) | {*(COMPARED_ON_FEW if few else ())}
            left_out |= {"pretrained"} if suite.name == "study" or problem not in policies.names() else set()
            assert {cell.agent for cell in cells if cell.problem == problem} == {*LEARNERS, *EXPERTS} - left_out
    assert set(SUITES["full"].agents) == {*SCENARIOS, *DISTRIBUTIONS}
    for problem, agents in SUITES["quick"].agents.items():
        assert all(can_fly(agent, problem) for agent in agents)


def test_prerequisites_are_selected_with_their_agent():
    suite = replace(SUITES["study"], seeds=1)
    assert [cell.agent for cell in suite.cells(["hoop/bc-ppo"])] == ["bc", "bc-ppo"]
    assert suite.cells(["hoop", "random-goal"]) == suite.cells()


def test_unknown_cells_are_named():
    with pytest.raises(ValueError, match=r"unknown cell 'hop/ppo'; known: hoop, hoop/bc, .*; did you mean 'hoop/ppo'"):
        SUITES["study"].cells(["hop/ppo"])


def test_a_track_of_ones_own_and_a_sample_join_a_suite_by_name(tmp_path):
    own = replace(SCENARIOS["hoop"], goal=(5.0, 4.0))  # called hoop
    path, near = tmp_path / "track.json", replace(DISTRIBUTIONS["random-hoops"], name="near", half_width=4.0)
    path.write_text(own.to_json())
    (tmp_path / "near.json").write_text(near.to_json())
    only = [f"{path}/pd", "random-hoops-3-0", "hoop/ppo", str(tmp_path / "near.json")]
    suite, wanted = SUITES["quick"].with_own(only)
    label = f"hoop-{own.digest[:8]}"
    assert wanted == [f"{label}/pd", "random-hoops-3-0", "hoop/ppo", f"near-{near.digest[:8]}"]
    cells = suite.cells(wanted)
    by_label = {cell.label: {one.agent for one in cells if one.label == cell.label} for cell in cells}
    assert by_label[label] == {"pd"}
    assert by_label["hoop"] == {"ppo"}
    assert by_label["random-hoops-3-0"] == {*LEARNERS, *EXPERTS} - {"pretrained"}
    assert by_label[wanted[3]] == {*LEARNERS, *EXPERTS} - {"pretrained", *SCENARIO_ONLY}
    (cell,) = [cell for cell in cells if cell.label == label]
    assert catalogue.problem(cell.problem) == own
    assert cell.path(tmp_path).name == f"{label}-pd-0.json"
    assert cell.row == {"problem": label, "agent": "pd", "seed": 0}


def test_results_hold_the_content_of_tasks_of_ones_own(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    own = Scenario("hoop", (0, 0), (1, 0))
    rows = own_tasks([catalogue.text(own), "hoop", "random-goal"])
    label = f"hoop-{own.digest[:8]}"
    assert list(rows) == [label]
    found = scenarios_of({"tasks": json.loads(json.dumps(rows))})
    scenario, best = found[label]
    assert (scenario, len(best.actions)) == (own, best.k_star)
    assert fly_actions(own, best.actions)[-1].outcome[0] == GOAL
    assert found["hoop"][0] == SCENARIOS["hoop"]
    results = {"cells": [], "k_star": {}, "validation_k_star": {}, "tasks": rows}
    assert merge(results | {"tasks": {}}, results)["tasks"] == select_problem(label, results)["tasks"] == rows
    assert select_problem("hoop", results)["tasks"] == {}
