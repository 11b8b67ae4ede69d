"""The command line: tables, JSON, help with examples, and exit statuses that mean something."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

import optimal
from experiments import terminal
from experiments.cli import app
from experiments.files import ROOT
from flatgym import DISTRIBUTIONS, SCENARIOS
from flatgym.scenarios.reference import reference
from tests.experiments.cli.shell import flatquad

COMMANDS = (
    "list",
    "solve",
    "paper",
    "demos",
    "train",
    "evaluate",
    "verify",
    "benchmark",
    "report",
    "play",
    "pretrain",
    "publish",
)
WITHOUT_TABLE = ("play", "pretrain", "publish")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(command):
    result = CliRunner().invoke(app.app, [command, "--help"])
    assert result.exit_code == 0
    assert f"flatquad {command}" in result.output
    assert ("--json" in result.output) == (command not in WITHOUT_TABLE)


@pytest.mark.parametrize("command", ["solvers", "environments", "demonstrations", "reference"])
def test_help_of_measurements_has_an_example(command):
    result = CliRunner().invoke(app.app, ["measure", command, "--help"])
    assert result.exit_code == 0
    assert f"flatquad measure {command}" in " ".join(result.output.split())


def listed(monkeypatch, capsys):
    """Return what `flatquad list --json` prints, by name."""
    status, out, _ = flatquad(monkeypatch, capsys, "list", "--json")
    assert status == 0
    return {row["scenario"]: row for row in json.loads(out)}


def test_list_names_every_scenario_and_distribution(monkeypatch, capsys):
    rows = listed(monkeypatch, capsys)
    assert list(rows) == [*SCENARIOS, *DISTRIBUTIONS]
    assert [row["kind"] for row in rows.values()] == ["scenario"] * len(SCENARIOS) + ["distribution"] * len(
        DISTRIBUTIONS
    )
    assert [rows[name]["hoops"] for name in DISTRIBUTIONS] == [0, "1 to 3", "4 to 8"]
    assert "2 to 4 m" in rows["random-track"]["goal"]


def test_list_tells_what_is_known_of_each_optimum(monkeypatch, capsys):
    rows = listed(monkeypatch, capsys)
    for name in SCENARIOS:
        row, known = rows[name], reference(name)
        assert (row["k_star"], row["k_lower_bound"], row["proven"]) == (known.k_star, known.k_lower_bound, known.proven)
        assert isinstance(row["k_star"], int)
        assert (row["time_s"], row["lower_bound_s"]) == (known.time, known.time_lower_bound)
    for name in DISTRIBUTIONS:
        assert {rows[name][key] for key in ("k_star", "k_lower_bound", "proven", "time_s", "lower_bound_s")} == {None}


@pytest.mark.parametrize("width", [80, 60])
def test_list_prints_tables_in_which_no_bound_is_rounded_upwards(monkeypatch, capsys, width):
    monkeypatch.setattr(terminal, "screen", Console(width=width))
    status, out, _ = flatquad(monkeypatch, capsys, "list")
    assert status == 0
    cells = [line.replace("│", " ").split() for line in out.splitlines()]
    rows = {line[0]: line for line in cells if line and line[0] in SCENARIOS}
    assert list(rows) == list(SCENARIOS)
    for name, row in rows.items():
        *_, time, bound, k_star, proven = row
        known = reference(name)
        assert float(time) == pytest.approx(known.time, abs=5e-6)
        assert known.time_lower_bound - 1.1e-5 < float(bound) <= known.time_lower_bound
        assert (int(k_star), proven) == (known.k_star, "yes" if known.proven else "no")
    assert all(name in out for name in DISTRIBUTIONS)
    assert max(map(len, out.splitlines())) <= width


def test_solve_prints_the_certified_row(monkeypatch, capsys):
    status, out, _ = flatquad(monkeypatch, capsys, "solve", "horizontal-3", "--json", "--steps")
    (row,) = json.loads(out)
    assert status == 0
    assert row["time_s"] == pytest.approx(0.8987, abs=5e-4)
    assert row["k_star"] == 44
    assert row["max_control_violation"] == 0


def test_solve_says_what_is_certified_and_what_is_proven(monkeypatch, capsys):
    status, out, _ = flatquad(monkeypatch, capsys, "solve", "horizontal-3")
    assert status == 0
    assert out.startswith("Certified flight in 0.8987 s, optimal; proven within 0.10 %.")


def test_solve_writes_the_flight(monkeypatch, capsys, tmp_path):
    path = tmp_path / "new" / "flight.csv"
    status, _, err = flatquad(
        monkeypatch, capsys, "solve", "horizontal-3", "--out", str(path), "--dt", "0.05", "--json"
    )
    assert status == 0
    assert "sampled every 0.05 s: a reference to track" in err
    sampled = optimal.load(path)
    assert not sampled.held
    assert sampled.time[-1] == pytest.approx(0.8987, abs=5e-4)


def test_solve_writes_steps_that_can_be_held(monkeypatch, capsys, tmp_path):
    path, task = tmp_path / "held.csv", SCENARIOS["horizontal-3"]
    status, _, err = flatquad(monkeypatch, capsys, "solve", "horizontal-3", "--steps", "--out", str(path), "--json")
    assert status == 0
    assert "controls to hold for 44 steps of 0.02 s" in err
    held = optimal.load(path)
    assert held.held
    end = task.quadrotor.fly(task.start_state, held.control[:-1], np.diff(held.time))[-1]
    assert np.hypot(*(end - task.goal_state)[0:2]) <= task.tolerance.position


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["--out", "{}/new/flight.xlsx"], 2, "unknown ending '.xlsx' of flight.xlsx; known: .csv, .json, .npz"),
        (["--out", "{}/file/x.csv"], 1, "x.csv cannot be made"),
        (["--out", "{}"], 2, "unknown ending ''"),
        (["--out", "{}/flight.csv", "--dt", "0"], 2, "dt must be positive, got 0.0"),
        (["--out", "{}/flight.csv", "--dt", "nan"], 2, "dt must be finite, got nan"),
        (["--dt", "0"], 2, "dt must be positive"),
        (
            ["--steps", "--out", "{}/x.csv", "--dt", "0.01"],
            2,
            "--dt samples the flight, but --steps --out writes steps",
        ),
        (["--limits", "foo"], 2, "checks='foo' is an option of flat"),
        (["--method", "flat", "--limits", "foo"], 2, "checks must be"),
        (["--gap", "0"], 2, "max_gap must be positive"),
    ],
)
def test_bad_arguments_of_solve_are_refused_before_the_work(monkeypatch, capsys, tmp_path, arguments, status, words):
    (tmp_path / "file").write_text("")
    for part in ("by_flat_method", "by_shooting"):
        if "flat" not in arguments:  # the flat method checks its own options
            monkeypatch.setattr(f"optimal.minimum_time.{part}", lambda *_: pytest.fail("a solve began"))
    given = [argument.format(tmp_path) for argument in arguments]
    code, out, err = flatquad(monkeypatch, capsys, "solve", "horizontal-3", *given)
    assert code == status
    assert words in " ".join(err.split())
    assert out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["solve", "hop"], "did you mean 'hoop'"),
        (["solve", "hoop", "--method", "flt"], "did you mean 'flat'"),
        (["solve", "hoop", "--speed", "9"], "No such option"),
        (["solve", "horizontal-3", "--out", "flight.pkl"], "unknown ending '.pkl'"),
        (["demos", "hoop", "-n", "0"], "greater than or equal"),
        (["measure", "solvers", "sped"], "unknown section 'sped'; known: references, starts"),
        (["pretrain", "hop"], "did you mean 'hoop'"),
        (["benchmark", "--full", "--study"], "give one of them"),
        (["benchmark", "--only", "hoop/pppo"], "unknown cell 'hoop/pppo'; known: hoop, "),
        (["demos", "hoop", "--backend", "lokky"], "unknown backend 'lokky'; known: loky, ray; did you mean 'loky'?"),
        (["demos", "hoop", "-n", "3", "--start-spread", "100"], "spread must be at most 5 m, got 100"),
        (["demos", "hoop", "--append", "--overwrite"], "give one of them"),
        (["demos", "hoop", "--export", "rows.xlsx"], "unknown ending '.xlsx' of rows.xlsx; known: .csv, .parquet"),
        (["evaluate", "--pretrained", "hop"], "did you mean 'hoop'?"),
        (["evaluate", "--agent", "expret", "--scenario", "hoop"], "did you mean 'expert'?"),
        (["report", "--out", "page.pdf"], "unknown ending '.pdf' of page.pdf; known: .html"),
        (["play", "--video", "flight.avi"], "unknown ending '.avi' of flight.avi; known: .mp4, .gif"),
        (["paper", "--out", "paper.csv"], "unknown ending '.csv' of paper.csv; known: .json"),
        (["measure", "solvers", "references", "--out", "solvers.txt"], "unknown ending '.txt' of solvers.txt"),
    ],
)
def test_bad_arguments_exit_2_with_the_way_out(monkeypatch, capsys, tmp_path, arguments, words):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    status, _, err = flatquad(monkeypatch, capsys, *arguments)
    assert status == 2
    assert words in " ".join(err.split())


@pytest.mark.parametrize(
    "arguments",
    [
        ("demos", "hoop", "--export", "file/rows.csv"),
        ("train", "hoop", "--folder", "file/run"),
        ("benchmark", "--out", "file/results"),
        ("evaluate", "--pretrained", "hoop", "--out", "file/score.json"),
        ("evaluate", "--pretrained", "hoop", "--report", "file/page.html"),
        ("report", "--out", "file/page.html"),
        ("paper", "--out", "file/paper.json"),
        ("play", "--video", "file/flight.mp4"),
        ("measure", "reference", "--out", "file/reference.json"),
        ("measure", "environments", "batched", "--out", "file/envs.json"),
    ],
)
def test_an_output_that_cannot_be_written_is_refused_before_the_work(monkeypatch, capsys, tmp_path, arguments):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    (tmp_path / "file").write_text("mine")
    status, out, err = flatquad(monkeypatch, capsys, *arguments)
    assert (status, out) == (1, "")
    assert "cannot be made" in err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "mine"


def test_a_failure_exits_1(monkeypatch, capsys):
    impossible = '{"name": "far", "start": [0, 0], "goal": [900, 0], "time_limit": 1.0}'
    status, _, err = flatquad(monkeypatch, capsys, "demos", impossible, "-n", "1")
    assert status == 1
    assert "no flight of this scenario exists" in " ".join(err.split())


def test_demos_are_recorded(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    status, out, _ = flatquad(monkeypatch, capsys, "demos", "horizontal-3", "-n", "2", "--out", "mine/v-v0", "--json")
    assert status == 0
    (row,) = json.loads(out)
    assert row["dataset"] == "mine/v-v0"
    assert row["episodes"] == 2
    status, _, err = flatquad(monkeypatch, capsys, "demos", "horizontal-3", "-n", "1", "--out", "mine/v-v0")
    assert status == 2
    assert "dataset 'mine/v-v0' exists, with 2 episodes: extend it (--append" in err
    for option, episodes in (("--append", 3), ("--overwrite", 1)):
        arguments = ("demos", "horizontal-3", "-n", "1", "--out", "mine/v-v0", option, "--json")
        status, out, _ = flatquad(monkeypatch, capsys, *arguments)
        assert (status, json.loads(out)[0]["episodes"]) == (0, episodes)


def test_a_missing_extra_is_a_sentence_and_exits_1():
    code = "import sys; sys.modules['typer'] = None; sys.argv[0] = 'flatquad'; import experiments"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "failed: typer not installed; run: pip install 'flatgym[experiments]'\n"


def test_commands_and_their_workers_do_not_warn_of_replaced_workers():
    warn = "import warnings; warnings.warn('A worker stopped while some jobs were given to the executor.')"
    script = f"""
import subprocess, sys
from experiments.cli import app
def warn():
    {warn}
    subprocess.run([sys.executable, "-c", {warn!r}], check=True)
app.app.command("warn")(warn)
sys.argv = ["flatquad", "warn"]
app.main()
"""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONWARNINGS"}
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
