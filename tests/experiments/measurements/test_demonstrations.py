"""The measurement of demonstrations at small size: every section runs, and its rows are consistent."""

import json
import os

import pytest
from typer.testing import CliRunner

from experiments.cli import app
from experiments.measurements import demonstrations
from experiments.measurements.demonstrations import SECTIONS


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    out = tmp_path_factory.mktemp("demos") / "demos.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demonstrations, "JOBS", 1)
        patch.setenv("MINARI_DATASETS_PATH", str(out.parent / "mine"))
        CliRunner().invoke(app.app, ["measure", "demonstrations", "--quick", "--out", str(out)], catch_exceptions=False)
        assert os.environ["MINARI_DATASETS_PATH"] == str(out.parent / "mine")
        assert not (out.parent / "mine").exists()
    return json.loads(out.read_text())


def test_all_flights_replay_to_the_goal(results):
    assert list(results["sections"]) == list(SECTIONS)
    for name, section in results["sections"].items():
        (row,) = section["rows"]
        assert row["replayed_to_goal"] == 1
        assert sum(row["statuses"].values()) == row["flights"]
        assert row["perturbed"] == (row["flights"] / 2 if name == "perturbed" else 0)
        assert row["per_second"] == pytest.approx(row["flights"] / (row["planning_s"] + row["recording_s"]))
    assert results["processor"]
