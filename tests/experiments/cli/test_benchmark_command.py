"""`flatquad benchmark` and `flatquad report`: failures, interrupted runs, damaged files, bad arguments."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest

from agents.policies.archive import PRETRAINED
from agents.policies.fingerprint import fingerprint
from experiments.benchmark import suite
from experiments.benchmark.results import merge, select_problem
from experiments.benchmark.suite import SUITES, Suite
from experiments.cli import app
from experiments.files import PUBLISHED, published
from experiments.recipes.run_spec import SMOKE
from tests.experiments.cli.shell import flatquad

SMALL = Suite(
    "quick",
    {"climb": ("bc", "pd", "pretrained")},
    seeds=2,
    budget=replace(SMOKE, gradient_steps=(5, 5), expert_rollouts=2),
)
HOSTILE = "import time\n\n\ndef crash(seen):\n    return 1 / 0\n\n\ndef hang(seen):\n    time.sleep(600)\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which the small benchmark has run beside policies that crash and hang; what was printed."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "hostile_pilots.py").write_text(HOSTILE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setitem(suite.SUITES, "quick", SMALL)
        arguments = ["--policy", "crasher=hostile_pilots:crash", "--policy", "sleeper=hostile_pilots:hang"]
        patch.setattr(sys, "argv", ["flatquad", "benchmark", *arguments, "--timeout", "2", "--out", ".", "--json"])
        with pytest.raises(SystemExit) as end:
            app.main()
    assert end.value.code == 1
    return folder


def test_failures_are_reported_and_the_rest_goes_on(folder):
    results = json.loads((folder / "benchmark.json").read_text())
    cells = {(cell["agent"], cell["seed"]): cell for cell in results["cells"]}
    assert set(cells) == {("bc", 0), ("bc", 1), ("pd", 0), ("pretrained", 0), ("crasher", 0), ("sleeper", 0)}
    assert "ZeroDivisionError" in cells["crasher", 0]["error"]
    assert "no answer within 2 s" in cells["sleeper", 0]["error"]
    assert cells["pretrained", 0]["fingerprint"] == fingerprint(PRETRAINED / "climb.zip")
    assert cells["bc", 1]["fingerprint"] == fingerprint(folder / "benchmark" / "climb-bc-1.zip")
    assert cells["pd", 0]["fingerprint"] is None
    assert cells["pretrained", 0]["episodes"]["nominal"]["steps"] == results["k_star"]["climb"][:1]
    assert results["commit"] is None or len(results["commit"]) in (40, 41)
    table = (folder / "benchmark.csv").read_text()
    page = (folder / "report.html").read_text()
    for text in (table, page):
        assert all(agent in text for agent in ("crasher", "sleeper", "ZeroDivisionError"))


def timeless(results):
    """Return results without what a clock or the command line wrote into them."""
    cells = [{key: value for key, value in cell.items() if key not in TIMES} for cell in results["cells"]]
    for cell in cells:
        cell["episodes"] = {name: flown | {"wall_time_s": 0} for name, flown in cell["episodes"].items()}
        cell["curve"] = [point | {"wall_time_s": 0} for point in cell.get("curve", ())]
    return {key: value for key, value in results.items() if key not in TIMES} | {"cells": cells}


TIMES = ("date", "command", "commit", "training_s", "planning_s")


def test_a_killed_run_resumes_and_ends_the_same(folder, tmp_path):
    code = (
        "from experiments.benchmark.run import run\nfrom tests_small import SMALL\n"
        "from experiments.terminal import progress_bar\nfrom pathlib import Path\n"
        "with progress_bar() as bar: run(SMALL, Path('mine'), command='x', bar=bar, jobs=1)\n"
    )
    (tmp_path / "tests_small.py").write_text(
        "from dataclasses import replace\n"
        "from experiments.benchmark.suite import Suite\nfrom experiments.recipes.run_spec import SMOKE\n"
        "SMALL = Suite('quick', {'climb': ('bc', 'pd', 'pretrained')}, seeds=2,\n"
        "              budget=replace(SMOKE, gradient_steps=(5, 5), expert_rollouts=2))\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, stderr=subprocess.DEVNULL) as process:
        while not list(tmp_path.glob("mine/*.json")) and process.poll() is None:
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True, stderr=subprocess.DEVNULL)
    uninterrupted = json.loads((folder / "benchmark.json").read_text())
    uninterrupted["cells"] = [cell for cell in uninterrupted["cells"] if not cell.get("error")]
    assert timeless(json.loads((tmp_path / "mine.json").read_text())) == timeless(uninterrupted)


def test_a_damaged_cell_is_named_moved_aside_and_repeated(folder, monkeypatch, capsys):
    cell = folder / "benchmark" / "climb-pd-0.json"
    before, half = json.loads(cell.read_text()), cell.read_text()[:99]
    cell.write_text(half)
    monkeypatch.chdir(folder)
    monkeypatch.setitem(SUITES, "quick", SMALL)
    status, out, err = flatquad(monkeypatch, capsys, "benchmark", "--out", ".", "--json")
    assert status == 0
    assert "climb-pd-0.json is damaged" in err
    assert (folder / "benchmark" / "climb-pd-0.json.set-aside").read_text() == half
    assert json.loads(cell.read_text())["episodes"]["nominal"]["steps"] == before["episodes"]["nominal"]["steps"]
    rows = json.loads(out)
    assert {row["agent"] for row in rows} == {"bc", "pd", "pretrained"}
    assert all(row["gap"] is None or row["gap_low"] <= row["gap"] <= row["gap_high"] for row in rows)


def test_a_run_continues_the_cells_of_a_results_file(folder, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(SUITES, "quick", SMALL)
    before = json.loads((folder / "benchmark.json").read_text())
    kept = [cell for cell in before["cells"] if cell["agent"] != "pd"]
    (tmp_path / "earlier.json").write_text(json.dumps(before | {"cells": kept}))
    status, _, err = flatquad(monkeypatch, capsys, "benchmark", "--resume", "earlier.json", "--out", ".", "--json")
    assert status == 0, err
    after = json.loads((tmp_path / "benchmark.json").read_text())
    cells = {(cell["agent"], cell["seed"]): cell for cell in after["cells"]}
    assert all(cells[cell["agent"], cell["seed"]] == cell for cell in kept if not cell.get("error"))
    assert ("pd", 0) in cells
    assert after["k_star"] == before["k_star"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--policy", "mine"), "NAME=ZIP or NAME=MODULE:OBJECT"),
        (("--policy", "ppo=a:b"), "'ppo' cannot be a policy's name"),
        (("--policy", "mine=mine.zip"), "--trust"),
        (("--only", "hop"), "unknown cell 'hop'; known: hoop"),
        (("--resume", "nowhere.json"), "nowhere.json is no results file of `flatquad benchmark`"),
        (("--full", "--resume", str(PUBLISHED / "benchmark.json")), "of the suite 'quick', and this run is of 'full'"),
    ],
)
def test_bad_arguments_are_named(monkeypatch, capsys, tmp_path, arguments, words):
    monkeypatch.chdir(tmp_path)
    status, out, err = flatquad(monkeypatch, capsys, "benchmark", *arguments)
    assert (status, out) == (2, "")
    assert words in err


@pytest.mark.parametrize(
    ("arguments", "nearest"), [(("benchmark", "--ful"), "--full"), (("evaluate", "--scenaro", "x"), "--scenario")]
)
def test_an_unknown_option_suggests_the_nearest(monkeypatch, capsys, arguments, nearest):
    status, _, err = flatquad(monkeypatch, capsys, *arguments)
    assert status == 2
    assert nearest in err


def test_the_report_shows_the_published_results_by_default(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    status, out, _ = flatquad(monkeypatch, capsys, "report", "--out", "mine.html", "--json")
    assert status == 0
    assert json.loads(out) == {"report": str(tmp_path / "mine.html"), "bytes": (tmp_path / "mine.html").stat().st_size}
    (tmp_path / "half.json").write_text('{"schema": 2, "cel')
    status, _, err = flatquad(monkeypatch, capsys, "report", "--results", "half.json")
    assert status == 2
    assert "half.json is damaged" in err
    assert (tmp_path / "half.json").read_text() == '{"schema": 2, "cel'
    (tmp_path / "notes.json").write_text("[1, 2]")
    for arguments in (("report", "--results"), ("measure", "solvers", "references", "--quick", "--out")):
        status, _, err = flatquad(monkeypatch, capsys, *arguments, "notes.json")
        assert status == 2
        assert "notes.json" in err
        assert (tmp_path / "notes.json").read_text() == "[1, 2]"
    (tmp_path / "old.json").write_text('{"schema": 1, "command": "flatquad benchmark"}')
    status, _, err = flatquad(monkeypatch, capsys, "report", "--results", "old.json")
    assert status == 2
    assert "old.json has schema 1, this version reads 2: run the command again, `flatquad benchmark`" in err
    status, _, err = flatquad(monkeypatch, capsys, "report", "--results", "missing.json")
    assert status == 2
    assert "there is no missing.json" in err
    assert not list(tmp_path.glob("*.set-aside"))


def test_results_are_merged_without_mixing_runs_of_an_agent():
    results = published("learners.json")
    hoop = select_problem("hoop", results)
    assert {cell["problem"] for cell in hoop["cells"]} == set(hoop["k_star"]) == {"hoop"}
    both = merge(hoop, results)
    key = [(cell["problem"], cell["agent"], cell["seed"]) for cell in both["cells"]]
    assert len(set(key)) == len(key) == len(results["cells"])
    assert both["k_star"] == results["k_star"]
    first = hoop["cells"][0] | {"seed": 99}
    mine = merge(hoop | {"cells": [first]}, hoop)["cells"]
    assert [cell["seed"] for cell in mine if cell["agent"] == first["agent"]] == [99]
