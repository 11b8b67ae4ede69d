"""The record of trainings: what was changed, what it gave, and one line in the table for each."""

import json
from dataclasses import replace

import pytest

from agents.training.configs import PPOConfig, SACConfig
from experiments.benchmark.trainings import add_records, changed, main, training_record
from experiments.files import published
from experiments.provenance import processor
from experiments.publishing.study import training_line, trainings

POINT = {"env_steps": 10, "wall_time_s": 1.0, "outcome": "goal", "success_rate": 1.0, "steps": 77}


@pytest.fixture
def folder(tmp_path):
    """The folder of a training whose second validation was the best."""
    config = PPOConfig(scenario="hoop", seed=3, width=128, bins=None, max_seconds=9.0, folder=str(tmp_path))
    (tmp_path / "config.json").write_text(config.to_json())
    curve = [POINT | {"success_rate": 0.0}, POINT | {"env_steps": 20}, POINT | {"env_steps": 30, "steps": 80}]
    (tmp_path / "curve.jsonl").write_text("".join(json.dumps(point) + "\n" for point in curve))
    return tmp_path


def test_a_record_states_the_best_validation_and_what_was_changed(folder):
    row = training_record(folder, beside_other_work=True)
    assert row["changed"] == {"width": 128, "bins": None}
    assert (row["steps"], row["k_star"], row["best_at"], row["env_steps"], row["seed"]) == (77, 70.0, 20, 30, 3)
    assert training_line(row) == [
        "`hoop`", "PPO", "`width=128`, `bins=None`", "3", "100 %", "77", "70", "+10.0 %", "0.0 k", "1*", processor(),
    ]  # fmt: skip


def test_a_training_without_success_is_a_row_too(folder):
    (folder / "curve.jsonl").write_text(json.dumps(POINT | {"success_rate": 0.0}) + "\n")
    assert training_line(training_record(folder))[4:8] == ["0 %", "-", "70", "-"]


def test_defaults_are_no_changes():
    assert changed(SACConfig(scenario="slalom", seed=7, folder="x", max_seconds=1.0)) == {}


def test_a_training_is_recorded_once_and_the_table_states_all(folder, tmp_path, monkeypatch):
    out = tmp_path / "out" / "trainings.json"
    out.parent.mkdir()
    monkeypatch.setattr("experiments.benchmark.trainings._published", lambda: None)
    for _ in range(2):
        main([str(folder)], out)
    config = replace(PPOConfig(scenario="horizontal-6"), folder=str(folder))
    (folder / "config.json").write_text(config.to_json())
    main([str(folder), "--beside-other-work"], out)
    results = json.loads(out.read_text())
    assert [row["problem"] for row in results["trainings"]] == ["horizontal-6", "hoop"]
    text = trainings(results)
    assert text.count("\n| `") == 2
    assert add_records(results, results["trainings"], "again")["trainings"] == results["trainings"]


def test_published_trainings_fly_no_faster_than_k_star():
    rows = published("trainings.json")["trainings"]
    assert rows
    for row in rows:
        assert row["steps"] is None or row["success_rate"] < 1 or row["steps"] >= row["k_star"]
