"""The measurement of the solvers at small size: every section runs, and its rows are consistent."""

import json

import numpy as np
import pytest

from experiments.files import SCHEMA
from experiments.measurements import proofs
from experiments.measurements.rockit import rockit_solver
from experiments.measurements.sections import SAME, SOURCE, convergence_order, join, uniform_goal
from experiments.measurements.solvers import SECTIONS
from flatgym import SCENARIOS


def test_every_section_has_rows_and_provenance(results):
    assert results["schema"] == SCHEMA
    assert results["smoke"] is True
    assert {"versions", "machine", "processor", "commit"} <= set(results)
    for section in results["sections"].values():
        assert section["command"] == results["command"] == "flatquad measure solvers --quick"
        assert {"wall_time_s", "date", "commit"} <= set(section)
    assert list(results["sections"]) == list(SECTIONS)
    assert all(section["rows"] for section in results["sections"].values())


def test_references_are_met(results):
    for row in results["sections"]["references"]["rows"]:
        assert row["status"].startswith("Solved")
        assert abs(row["deviation"]) < 2e-4


def test_bounds_are_checked_and_never_above_a_flight(results):
    sections = {name: section["rows"] for name, section in results["sections"].items()}
    for row in [*sections["bounds"], *sections["goal_bounds"][:-1]]:
        assert row["checked"]
        assert row["lower_bound_s"] < row["upper_bound_s"]
        assert row["gap"] == pytest.approx(row["upper_bound_s"] / row["lower_bound_s"] - 1)
    assert [row["limits"] for row in sections["validity"]] == list(proofs.LIMITS)
    assert all(row["above_a_flight"] == 0 < row["goals"] for row in sections["validity"])


def test_steps_replay_and_are_proven(results):
    for row in [*results["sections"]["steps"]["rows"], *results["sections"]["goal_steps"]["rows"][:-1]]:
        assert row["replays_scalar"]
        assert row["proven"] == (row["k_star"] == row["lower_bound"])


def test_only_the_true_flight_passes(results):
    passed = [row["broken"] for row in results["sections"]["broken"]["rows"] if row["holds"]]
    assert passed == ["true"]


def test_sections_join_a_file_of_the_same_kind_and_any_other_is_moved_aside(tmp_path, capsys):
    path = tmp_path / "solvers.json"
    old, new = ({**dict.fromkeys(SAME, 1), "sections": {name: {"rows": []}}} for name in ("old", "new"))
    assert join(path, new) == new
    path.write_text(json.dumps(old))
    assert list(join(path, new)["sections"]) == ["old", "new"]
    for i, text in enumerate(['{"schema": 0, "sections": {}}', "[1, 2", "[]"]):
        path.write_text(text)
        assert join(path, new) == new
        assert not path.exists()
        assert "moved aside" in capsys.readouterr().err
        assert len(list(tmp_path.glob("*set-aside*"))) == i + 1


def test_joined_sections_keep_the_machine_on_which_they_ran(tmp_path):
    path = tmp_path / "solvers.json"
    head, rows = dict.fromkeys(SAME, 1), {"rows": []}
    own = {"machine": {"cores": 2}, "processor": "B"}
    path.write_text(json.dumps(head | {"machine": {"cores": 4}, "sections": {"old": rows, "both": rows}}))
    for section in ("both", "new"):  # the head of the file becomes that of the last run
        path.write_text(json.dumps(join(path, head | own | {"sections": {section: rows | own}})))
    sections = json.loads(path.read_text())["sections"]
    cores = {name: (section["machine"]["cores"], section.get("processor")) for name, section in sections.items()}
    assert cores == {"old": (4, None), "both": (2, "B"), "new": (2, "B")}


def test_each_section_states_where_it_ran(results):
    for section in results["sections"].values():
        assert {key: section[key] for key in SOURCE} == {key: results[key] for key in SOURCE}


def test_starts_are_counted(results):
    *rows, total = results["sections"]["starts"]["rows"]
    assert total["scenario"] == "all"
    assert total["starts"] == sum(row["starts"] for row in rows) == 9
    assert total["solved"] == len(rows)
    assert total["found_best"] <= total["converged"] <= total["starts"]


def test_both_solvers_find_the_same_flight(results):
    ours, rockit, load = results["sections"]["speed"]["rows"]
    assert ours["time_s"] == pytest.approx(rockit["time_s"], rel=1e-3)  # Runge-Kutta on ten steps is not exact
    assert all(row["median_s"] > 0 for row in (ours, rockit, load))


def test_batches_are_counted(results):
    for row in results["sections"]["batch"]["rows"]:
        assert row["per_second"] == pytest.approx(row["scenarios"] / row["wall_time_s"])
        assert sum(row["statuses"].values()) == row["scenarios"]
        assert all(status.startswith("Solved") for status in row["statuses"])


def test_the_order_of_a_known_sequence_is_found():
    nodes = (10, 20, 40)
    assert convergence_order(nodes, [3.0 / n**2 for n in nodes]) == pytest.approx(2)


def test_uniform_goals_are_away_from_the_start():
    goals = np.array([uniform_goal(np.random.default_rng(seed), 0).goal for seed in range(200)])
    assert np.abs(goals).max() <= 10
    assert np.hypot(*goals.T).min() >= 0.5


def test_rockit_refuses_hoops():
    with pytest.raises(ValueError, match="without hoops, floor and ceiling, got 'hoop'"):
        rockit_solver(SCENARIOS["hoop"], 10)
