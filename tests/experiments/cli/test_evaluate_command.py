"""`flatquad evaluate`: one score row for any policy."""

import json
import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest
from typer.testing import CliRunner

import flatgym
from agents.evaluation.scores import COLUMNS
from experiments.cli import app
from experiments.cli import evaluate as command
from flatgym import Hoop, Scenario
from flatgym.scenarios.files import to_text
from flatgym.scenarios.reference import EVALUATION_SEED
from tests.experiments.cli.shell import flatquad


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """Nothing is kept outside the test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "flatquad"


def evaluate(monkeypatch, capsys, *arguments):
    """Run `flatquad evaluate`; returns as `flatquad` does."""
    return flatquad(monkeypatch, capsys, "evaluate", *arguments)


def test_the_cascade_is_scored(monkeypatch, capsys):
    arguments = ("--agent", "pd", "--scenario", "random-hoops", "--episodes", "20", "--json")
    status, out, _ = evaluate(monkeypatch, capsys, *arguments)
    (row,) = json.loads(out)
    assert status == 0
    assert list(row) == list(COLUMNS)
    assert (row["agent"], row["algorithm"], row["seed"]) == ("pd", "CascadedPD", EVALUATION_SEED)
    assert (row["success_rate"], row["outcomes"], row["disturbances"]) == (1.0, {"goal": 20}, {})
    assert row["command"] == " ".join(["flatquad", "evaluate", *arguments])


def test_the_expert_flies_in_k_star_steps_and_is_planned_once(monkeypatch, capsys, cache):
    arguments = ("--agent", "expert", "--scenario", "horizontal-3", "--episodes", "2")
    status, out, _ = evaluate(monkeypatch, capsys, *arguments)
    assert status == 0
    assert "goal 2" in out
    assert len(list(cache.iterdir())) == 1
    monkeypatch.setattr("joblib.Parallel", None)
    assert evaluate(monkeypatch, capsys, *arguments)[1] == out


def test_disturbances_reach_the_episodes(monkeypatch, capsys):
    options = {"wind": 2.0, "mass": 0.1, "thrust-gain": 0.05, "action-delay": 2, "sensor-noise": 0.01}
    words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    _, out, _ = evaluate(
        monkeypatch, capsys, "--agent", "pd", "--scenario", "hoop", "--episodes", "2", "--json", *words
    )
    (row,) = json.loads(out)
    assert row["disturbances"] == {name.replace("-", "_"): value for name, value in options.items()}


def test_a_policy_is_scored_on_the_scenario_it_was_trained_on(monkeypatch, capsys, tmp_path):
    from stable_baselines3 import PPO

    policies, vec_env = import_module("agents.policies"), import_module("agents.training.vec_env")
    model = PPO("MlpPolicy", vec_env.make_vec_env("climb", 2), n_steps=8, batch_size=16, device="cpu", seed=0)
    path = policies.save(model, tmp_path / "climber.zip", "climb")
    status, _, err = evaluate(monkeypatch, capsys, str(path))
    assert status == 2
    assert "trust" in err
    status, out, _ = evaluate(monkeypatch, capsys, str(path), "--trust", "--episodes", "1", "--json")
    (row,) = json.loads(out)
    assert status == 0
    assert (row["agent"], row["algorithm"], row["scenario"], row["env_steps"]) == ("climber", "PPO", "climb", 0)
    _, out, _ = evaluate(monkeypatch, capsys, str(path), "--trust", "--scenario", "drop", "--episodes", "1", "--json")
    assert json.loads(out)[0]["scenario"] == "drop"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "name one policy to score"),
        (("a.zip", "--agent", "pd"), "name one policy to score"),
        (("--agent", "pd"), "give --scenario"),
        (("--agent", "dp", "--scenario", "hoop"), "unknown agent 'dp'; known: expert, pd"),
        (("--agent", "pd", "--scenario", "hop"), "did you mean 'hoop'"),
        (("--agent", "expert", "--scenario", "random-goal"), "'random-goal' is a distribution"),
        (("--pretrained", "nobody"), "unknown pretrained policy 'nobody'"),
        (("--agent", "pd", "--scenario", "hoop", "--mass", "2"), "Disturbances.mass must be below 1"),
    ],
    ids=lambda value: "-".join(value) or "nothing" if isinstance(value, tuple) else "",
)
def test_bad_arguments_are_named(monkeypatch, capsys, arguments, words):
    status, out, err = evaluate(monkeypatch, capsys, *arguments)
    assert (status, out) == (2, "")
    assert words in err


def test_help_has_an_example():
    result = CliRunner().invoke(app.app, ["evaluate", "--help"])
    assert result.exit_code == 0
    assert "flatquad evaluate --pretrained hoop" in " ".join(result.output.split())


def test_a_policy_of_ones_own_is_scored_and_compared_with_ours(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_flatquad_agent.py").write_text(
        "from agents.controllers.cascaded_pd import CascadedPD\nfrom flatgym import Quadrotor\n\n\n"
        "class Mine:\n    def predict(self, seen):\n        return CascadedPD(Quadrotor()).predict(seen)[0]\n"
    )
    status, out, err = evaluate(
        monkeypatch, capsys, "my_flatquad_agent:Mine", "--scenario", "climb", "--report", "mine.html", "--json"
    )
    (row,) = json.loads(out)
    assert status == 0, err
    assert (row["agent"], row["scenario"], row["success_rate"]) == ("Mine", "climb", 1)
    assert str(tmp_path / "mine.html") in err
    assert f"its scores: {tmp_path}/mine.json, and {tmp_path}/mine/" in err
    cells = {cell["agent"]: cell for cell in json.loads((tmp_path / "mine.json").read_text())["cells"]}
    assert set(cells) == {"Mine", "pretrained", "expert", "open-loop", "pd"}
    assert (
        cells["Mine"]["episodes"]["nominal"]["steps"] == cells["pd"]["episodes"]["nominal"]["steps"] == [row["steps"]]
    )
    assert "Mine" in (tmp_path / "mine.html").read_text()


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("return 1 / 0", "PolicyFailed: hostile:policy failed: ZeroDivisionError: division by zero"),
        ("return observation[:, :3]", "hostile:policy returned actions of shape (100, 3)"),
        ("return observation[:, :2] * float('nan')", "must be finite"),
        ("while True: pass", "no answer within 5 s; --timeout grants more"),
        ("import os; os._exit(3)", "ended without an answer, with exit code 3"),
    ],
)
def test_a_policy_that_misbehaves_is_reported(monkeypatch, capsys, tmp_path, body, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hostile.py").write_text(f"def policy(observation):\n    {body}\n")
    status, out, err = evaluate(monkeypatch, capsys, "hostile:policy", "--scenario", "climb", "--timeout", "5")
    assert (status, out) == (2, "")
    assert words in err


GAP = Hoop(2.5, 3.2, 0.5)


@pytest.mark.parametrize(("name", "hoops"), [("hoop", (GAP,)), ("horizontal-3", ()), ("own", ())])
def test_the_report_of_an_own_scenario_shows_its_content_whatever_it_is_called(
    monkeypatch, capsys, tmp_path, name, hoops
):
    """A built-in name does not bring the built-in scenario, K*, or agents; the agent that is scored is in the page."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "COMPARED_WITH", ("pretrained",))
    own = replace(flatgym.SCENARIOS["diagonal"], name=name, goal=(1.5, 1.5) if not hoops else (5, 5), hoops=hoops)
    Path("track.toml").write_text(to_text(own, ".toml"))
    arguments = ("--agent", "pd", "--scenario", "track.toml", "--episodes", "1", "--report", "mine.html", "--json")
    status, out, err = evaluate(monkeypatch, capsys, *arguments)
    (row,) = json.loads(out)
    label = f"{name}-{own.digest[:8]}"
    assert (status, row["scenario"]) == (0, label), err
    results = json.loads(Path("mine.json").read_text())
    assert [(cell["problem"], cell["agent"]) for cell in results["cells"]] == [(label, "pd")]
    assert Scenario.from_dict(results["tasks"][label]["content"]) == own
    assert results["tasks"][label]["best"]["k_star"] == row["k_star"]
    page = Path("mine.html").read_text()
    races = json.loads(re.search(r'<script[^>]*id="races"[^>]*>(.*?)</script>', page, re.DOTALL)[1])
    assert races["first"] == label
    drawn = races["scenarios"][label]
    assert (drawn["goal"], drawn["k_star"], len(drawn["hoops"])) == ([*own.goal], row["k_star"], len(hoops))
    assert [entry["name"] for entry in drawn["entries"]] == [f"best known, K* = {row['k_star']}", "cascaded PD"]
