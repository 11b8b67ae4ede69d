"""Suites: every agent flies every problem it can fly, and cells are selected by name."""

from dataclasses import replace

import pytest

from agents import policies
from experiments.benchmark.suite import SUITES, can_fly
from experiments.recipes.registry import EXPERTS, LEARNERS, SCENARIO_ONLY
from flatgym import DISTRIBUTIONS, SCENARIOS


def test_suites_have_every_agent_on_every_problem_it_can_fly():
    for suite in (SUITES["study"], SUITES["full"]):
        cells = suite.cells()
        assert len(set(cells)) == len(cells)
        for problem in suite.agents:
            for agent in LEARNERS:
                assert [cell.seed for cell in cells if (cell.problem, cell.agent) == (problem, agent)] == [0, 1, 2]
            left_out = {*SCENARIO_ONLY} if problem in DISTRIBUTIONS else set()
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
    with pytest.raises(ValueError, match=r"unknown cells hop/ppo; known: hoop, hoop/bc, hoop/bc-ppo"):
        SUITES["study"].cells(["hop/ppo"])
