"""The command line: tables, JSON, help with examples, and exit statuses that mean something."""

import json
import sys

import pytest
from typer.testing import CliRunner

import optimal
from experiments import cli
from flatgym import SCENARIOS

COMMANDS = ("list", "solve", "paper", "demos", "benchmark")


def flatquad(monkeypatch, capsys, *arguments):
    """Run the command as a shell would; return exit status, standard output, standard error."""
    monkeypatch.setattr(sys, "argv", ["flatquad", *arguments])
    with pytest.raises(SystemExit) as end:
        cli.main()
    output = capsys.readouterr()
    return end.value.code, output.out, output.err


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(command):
    result = CliRunner().invoke(cli.app, [command, "--help"])
    assert result.exit_code == 0
    assert f"flatquad {command}" in result.output
    assert "--json" in result.output


def test_list_names_every_scenario(monkeypatch, capsys):
    status, out, _ = flatquad(monkeypatch, capsys, "list", "--json")
    assert status == 0
    assert [row["scenario"] for row in json.loads(out)] == list(SCENARIOS)


def test_solve_prints_the_certified_row(monkeypatch, capsys):
    status, out, _ = flatquad(monkeypatch, capsys, "solve", "horizontal-3", "--json", "--steps")
    (row,) = json.loads(out)
    assert status == 0
    assert row["time_s"] == pytest.approx(0.8987, abs=5e-4)
    assert row["k_star"] == 44
    assert row["max_control_violation"] == 0


def test_solve_writes_the_flight(monkeypatch, capsys, tmp_path):
    path = tmp_path / "flight.csv"
    status, _, _ = flatquad(monkeypatch, capsys, "solve", "horizontal-3", "--out", str(path), "--dt", "0.05", "--json")
    assert status == 0
    assert optimal.load(path).time[-1] == pytest.approx(0.8987, abs=5e-4)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["solve", "hop"], "did you mean 'hoop'"),
        (["solve", "hoop", "--method", "flt"], "did you mean 'flat'"),
        (["solve", "hoop", "--speed", "9"], "No such option"),
        (["solve", "horizontal-3", "--out", "flight.pkl"], "unknown ending '.pkl'"),
        (["demos", "hoop", "-n", "0"], "greater than or equal"),
    ],
)
def test_bad_arguments_exit_2_with_the_way_out(monkeypatch, capsys, arguments, words):
    status, _, err = flatquad(monkeypatch, capsys, *arguments)
    assert status == 2
    assert words in " ".join(err.split())


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
