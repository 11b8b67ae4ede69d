"""`--backend ray` with default options and no running cluster: demonstrations and scores are those of this machine."""

import json

import minari
import numpy as np

from experiments.benchmark.suite import SUITES, Suite
from tests.experiments.cli.shell import flatquad
from tests.optimal.test_cluster import run_script

COMMANDS = (
    ("demos", "horizontal-3", "-n", "2", "--out", "mine", "--json"),
    ("benchmark", "--out", "results", "--json"),
)
SCRIPT = """
import json, os, sys
from experiments.benchmark import suite
from experiments.cli import app
folder, *commands = sys.argv[1:]
os.chdir(folder)
suite.SUITES["quick"] = suite.Suite("quick", {"horizontal-3": ("pd",)})
for command in commands:
    sys.argv = ["flatquad", *json.loads(command), "--backend", "ray"]
    try:
        app.main()
    except SystemExit as end:
        assert not end.code
"""


def test_demonstrations_and_scores_are_those_of_this_machine(tmp_path, monkeypatch, capsys):
    here, there = tmp_path / "here", tmp_path / "there"
    for folder in (here, there):
        folder.mkdir()
        monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
        if folder == there:
            run_script(SCRIPT, str(there), *map(json.dumps, COMMANDS))
            continue
        monkeypatch.chdir(here)
        monkeypatch.setitem(SUITES, "quick", Suite("quick", {"horizontal-3": ("pd",)}))
        for command in COMMANDS:
            assert flatquad(monkeypatch, capsys, *command, "--jobs", "1")[0] == 0
    assert scores(here) == scores(there)
    one, other = demonstrated(monkeypatch, here), demonstrated(monkeypatch, there)
    assert len(one) == len(other) == 2
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def scores(folder):
    """Return the episodes of each cell without their wall times."""
    cells = json.loads((folder / "results" / "benchmark.json").read_text())["cells"]
    return {
        cell["agent"]: {name: flown | {"wall_time_s": 0} for name, flown in cell["episodes"].items()} for cell in cells
    }


def demonstrated(monkeypatch, folder):
    """Return the actions of all demonstrations in a folder."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    return [episode.actions for episode in minari.load_dataset("mine-v0").iterate_episodes()]
