"""The demonstrations' benchmark at small size: every section runs, and what it says of the flights is so."""

import json
import os

import pytest

from experiments.measurements import demonstrations
from experiments.measurements.demonstrations import SECTIONS, main


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    out = tmp_path_factory.mktemp("demos") / "demos.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demonstrations, "JOBS", 1)
        patch.setenv("MINARI_DATASETS_PATH", str(out.parent / "mine"))
        main(["--quick", "--out", str(out)])
        assert os.environ["MINARI_DATASETS_PATH"] == str(out.parent / "mine")
        assert not (out.parent / "mine").exists()
    return json.loads(out.read_text())


def test_all_flights_replay_to_the_goal(results):
    assert list(results["sections"]) == list(SECTIONS)
    for name, section in results["sections"].items():
        (row,) = section["rows"]
        assert row["replayed_to_goal"] == 1
        assert sum(row["statuses"].values()) == row["flights"]
        assert row["continued"] == (row["flights"] / 2 if name == "continuations" else 0)
        assert row["per_second"] == pytest.approx(row["flights"] / (row["planning_s"] + row["recording_s"]))
        assert section["command"].startswith("python -m experiments.measurements.demonstrations")
