"""The paper's table: what is printed lies, what is certified is flown."""

import json

import pandas as pd
import pytest
from typer.testing import CliRunner

from experiments import cli, paper, paper_figures, readme
from experiments.paper import COLUMNS, EASE_COLUMNS, PONTRYAGIN, PRINTED, compare, ease
from flatgym import SCENARIOS
from optimal.shooting import shoot


@pytest.fixture(scope="module")
def row():
    return compare("horizontal-3")


def test_the_order_of_the_roads(row):
    assert tuple(row) == COLUMNS
    # What is printed is faster than the optimum; no certified flight is.
    assert row["lower_bound_s"] < row["printed_s"] < row["shooting_s"] < row["flat_certified_s"]
    assert row["flat_certified_s"] < 1.003 * row["shooting_s"]
    assert row["shooting_s"] == pytest.approx(row["reference_8_s"], abs=2e-3)
    assert row["pontryagin_s"] == pytest.approx(row["shooting_s"], rel=1e-4)
    assert row["pontryagin_s"] <= row["shooting_s"]


def test_limits_at_nodes_only_are_no_flight(row):
    assert row["nodes_only_violation"] > 1


def test_reference_8_is_known_where_the_paper_prints_it():
    assert set(PONTRYAGIN) <= set(PRINTED)
    assert all(PRINTED[name] < time for name, time in PONTRYAGIN.items())
    assert all(paper.in_free_space(name) for name in PONTRYAGIN)


@pytest.mark.parametrize("road", ["shooting", "pontryagin"])
def test_direct_and_indirect_road_arrive_from_every_plain_start(road):
    found = ease("horizontal-3", road)
    assert tuple(found) == EASE_COLUMNS
    assert found["succeeded"] == found["converged"] == found["starts"]
    assert found["best_s"] == pytest.approx(0.8987, abs=2e-4)
    assert found["warm_s"] < found["cold_s"] * 2


def test_only_certified_flights_near_the_best_succeed(monkeypatch):
    scenario = SCENARIOS["horizontal-3"]
    direct = shoot(scenario, nodes=50)
    slow = shoot(scenario, winding=1, nodes=50)  # a flight with a turn takes longer
    assert direct.converged
    assert slow.trajectory.duration > direct.trajectory.duration * (1 + paper.SUCCESS)
    runs = {
        1: paper.Run(True, 10, direct.trajectory),
        2: paper.Run(True, 20, slow.trajectory),
        3: paper.Run(False, 30, None),
    }
    monkeypatch.setitem(paper.ROADS, "pretend", (lambda _, size: runs[size], 1, (1, 2, 3)))
    found = ease("horizontal-3", "pretend")
    assert (found["starts"], found["converged"], found["succeeded"]) == (3, 2, 1)
    assert found["iterations"] == 10
    monkeypatch.setitem(paper.ROADS, "pretend", (lambda *_: runs[3], 3, (3, 3)))
    found = ease("horizontal-3", "pretend")
    assert (found["best_s"], found["succeeded"]) == (float("inf"), 0)


def test_questions_ask_pontryagin_only_in_free_space():
    asked = paper.questions()
    assert len(asked) == len(set(asked)) == 8 * 4 + 6
    assert ("hoop", "pontryagin") not in asked


def test_tables_are_answered_in_their_own_processes(monkeypatch):
    monkeypatch.setattr(paper, "questions", lambda: [("horizontal-3", "shooting")])
    done = []
    rows, eased = paper.tables(lambda: done.append(1))
    assert rows.empty
    assert list(eased.columns) == list(EASE_COLUMNS)
    assert eased["road"].tolist() == ["shooting"]
    assert len(done) == 1


@pytest.fixture
def pretended(row, monkeypatch):
    """Both tables at hand, so that the command need not compute them, and no figures."""
    eased = dict(zip(EASE_COLUMNS, ("horizontal-3", "shooting", 0.8987, 24, 0.3, 0.02, 5, 5, 4), strict=True))
    monkeypatch.setattr(paper, "tables", lambda **_: (pd.DataFrame([row]), pd.DataFrame([eased])))
    monkeypatch.setattr(paper_figures, "FIGURES", {"figure-2": paper_figures.fig2})


@pytest.mark.usefixtures("pretended")
def test_the_command_prints_and_writes_both_tables_and_the_figures(tmp_path):
    out = tmp_path / "paper.json"
    result = CliRunner().invoke(cli.app, ["paper", "--json", "--out", str(out)])
    assert result.exit_code == 0
    printed, written = json.loads(result.stdout), json.loads(out.read_text())
    assert printed == {key: written[key] for key in ("rows", "ease")}
    assert (tmp_path / "figure-2.html").exists()
    readable = CliRunner().invoke(cli.app, ["paper", "--out", str(out)]).stdout
    assert "Pontryagin" in readable
    assert "found" in readable


@pytest.mark.usefixtures("pretended")
def test_readme_shows_both_tables(tmp_path):
    out = tmp_path / "paper.json"
    assert CliRunner().invoke(cli.app, ["paper", "--out", str(out)]).exit_code == 0
    text = readme.judged(json.loads(out.read_text()))
    assert "| T* (shooting) | Pontryagin | [8] |" in text
    assert "| shooting | 1 | 24 | 0.30 | 0.020 | 5 of 5 | 4 of 5 |" in text
