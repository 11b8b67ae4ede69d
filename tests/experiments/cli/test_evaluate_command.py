"""`flatquad evaluate`: one score row for any policy."""

import json
import math
import re
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest
from typer.testing import CliRunner

import flatgym
from agents.evaluation.scores import COLUMNS
from agents.policies import archive
from agents.policies.fingerprint import fingerprint
from experiments.cli import app
from experiments.cli import evaluate as command
from experiments.scoring import score
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
        (("--agent", "dp", "--scenario", "hoop"), "unknown agent 'dp'; known: expert, expert-no-margin, pd"),
        (("--agent", "pd", "--scenario", "hop"), "did you mean 'hoop'"),
        (("--agent", "expert", "--scenario", "random-goal"), "'random-goal' is a distribution"),
        (("--pretrained", "hoop", "--normalize", "a.pkl"), "--normalize and --algorithm are for a policy of your own"),
        (("mine.py", "--scenario", "hoop"), "mine.py is a Python file: name the policy in it"),
        (("mine", "--scenario", "hoop"), "'mine' is neither a file of a policy"),
        (("a.pt",), "a.pt does not name its scenario: give --scenario"),
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
    assert set(cells) == {"Mine", "pretrained", "expert", "open-loop", "pd", "hover", "random"}
    assert (
        cells["Mine"]["episodes"]["nominal"]["steps"] == cells["pd"]["episodes"]["nominal"]["steps"] == [row["steps"]]
    )
    assert "Mine" in (tmp_path / "mine.html").read_text()


def scored(monkeypatch, capsys, *arguments):
    """Return the row and the notes of `flatquad evaluate --json`."""
    status, out, err = evaluate(monkeypatch, capsys, *arguments, "--json")
    assert status == 0, err
    return json.loads(out)[0], err


@pytest.mark.parametrize(("problem", "episodes"), [("hoop", 1), ("random-hoops", 300), ("random-track", 100)])
def test_the_episodes_are_those_of_the_protocol(monkeypatch, capsys, problem, episodes):
    row, _ = scored(monkeypatch, capsys, "--agent", "pd", "--scenario", problem, "--k-star-time", "0")
    assert row["episodes"] == sum(row["outcomes"].values()) == episodes


def test_numbers_are_percent_with_intervals_and_say_what_mean_they_are(monkeypatch, capsys):
    arguments = ("--agent", "pd", "--scenario", "random-goal", "--episodes", "50")
    row, _ = scored(monkeypatch, capsys, *arguments)
    _, out, _ = evaluate(monkeypatch, capsys, *arguments)
    low, high = (f"{100 * row[key]:.1f}" for key in ("gap_low", "gap_high"))
    assert f"{100 * row['gap']:+.1f} %" in out
    assert f"[{low}, {high}]" in out
    assert "100 %" in out
    assert "interquartile means" in out
    _, single, _ = evaluate(monkeypatch, capsys, "--pretrained", "hoop")
    assert ("100 %" in single, "+0.0 %" in single, "interquartile" in single) == (True, True, False)


def test_json_holds_the_fingerprint_and_the_time(monkeypatch, capsys):
    row, _ = scored(monkeypatch, capsys, "--pretrained", "hoop")
    assert row["fingerprint"] == fingerprint(archive.PRETRAINED / "hoop.zip")
    assert row["wall_time_s"] > 0
    assert row["algorithm"] == "PPO"


def test_seeds_of_training_are_warned_of(monkeypatch, capsys):
    arguments = ("--agent", "pd", "--scenario", "random-goal", "--episodes", "2", "--k-star-time", "0")
    assert "note: seeds below 1,000,000 are for training" in scored(monkeypatch, capsys, *arguments, "--seed", "7")[1]
    assert "seeds below" not in scored(monkeypatch, capsys, *arguments)[1]


BACK = Scenario("back", (0, 0), (5, 0), (Hoop(3, 0, 1, math.pi),))
OPEN = Scenario("open", (0, 0), (2, 0))


def test_a_score_neither_waits_for_k_star_nor_is_lost_without_it(monkeypatch, capsys):
    began = time.perf_counter()
    row, err = scored(monkeypatch, capsys, "--agent", "pd", "--scenario", OPEN.to_json(), "--k-star-time", "0.05")
    assert time.perf_counter() - began < 60
    assert (row["success_rate"], row["k_star"], row["gap"]) == (1.0, None, None)
    assert row["steps"] > 0
    assert "K* was not found within 0.05 s, and is left out of the gap; --k-star-time grants more" in err
    _, out, _ = evaluate(monkeypatch, capsys, "--agent", "pd", "--scenario", OPEN.to_json(), "--k-star-time", "0")
    assert re.search(r"100 % +\d+ +- +- +goal 1", out)


def test_a_failed_flight_does_not_ask_for_k_star(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall_flatquad.py").write_text("def policy(seen):\n    return seen[:, :2] * 0 - 1\n")
    monkeypatch.setattr(score, "find_k_star", None)
    row, err = scored(monkeypatch, capsys, "fall_flatquad:policy", "--scenario", BACK.to_json())
    assert (row["success_rate"], row["k_star"], row["gap"]) == (0.0, None, None)
    assert "K*" not in err


def test_k_star_of_a_task_of_ones_own_is_computed_once(monkeypatch, capsys):
    arguments = ("--agent", "pd", "--scenario", OPEN.to_json())
    first, err = scored(monkeypatch, capsys, *arguments)
    assert first["k_star"] > 0
    assert first["gap"] == pytest.approx(first["steps"] / first["k_star"] - 1)
    assert "K*" not in err
    again, _ = scored(monkeypatch, capsys, *arguments, "--k-star-time", "0")
    assert again["k_star"] == first["k_star"]


def test_the_expert_is_that_of_the_benchmark(monkeypatch, capsys):
    wind = ("--scenario", "hoop", "--wind", "0.5", "--episodes", "40")
    with_margin, _ = scored(monkeypatch, capsys, "--agent", "expert", *wind)
    without, _ = scored(monkeypatch, capsys, "--agent", "expert-no-margin", *wind)
    assert with_margin["success_rate"] > 0.8 > 0.6 > without["success_rate"]


def test_a_normalised_model_brings_its_statistics(monkeypatch, capsys, tmp_path):
    from stable_baselines3 import SAC
    from stable_baselines3.common.vec_env import VecNormalize

    from agents.training.vec_env import make_vec_env

    monkeypatch.chdir(tmp_path)
    envs = VecNormalize(make_vec_env("random-goal", 4))
    model = SAC("MlpPolicy", envs, device="cpu", buffer_size=200, learning_starts=1000, seed=0).learn(80)
    model.save("sac.zip")
    envs.save("elsewhere.pkl")
    arguments = ("sac.zip", "--scenario", "hoop", "--trust")
    row, err = scored(monkeypatch, capsys, *arguments)
    assert "note: sac.zip seems to have been trained under VecNormalize" in err
    assert row["algorithm"] == "SAC"
    assert row["fingerprint"] == fingerprint("sac.zip")
    row, err = scored(monkeypatch, capsys, *arguments, "--normalize", "elsewhere.pkl", "--out", "score.json")
    assert "note" not in err
    assert row["fingerprint"] == fingerprint("sac.zip", Path("elsewhere.pkl")) != fingerprint("sac.zip")
    same = ("verify", "score.json", "--policy", "sac.zip", "--trust")
    assert flatquad(monkeypatch, capsys, *same, "--normalize", "elsewhere.pkl")[0] == 0
    status, out, _ = flatquad(monkeypatch, capsys, *same)
    assert (status, "its policy has the fingerprint" in " ".join(out.split())) == (2, True)
    status, _, err = evaluate(monkeypatch, capsys, *arguments, "--normalize", "nowhere.pkl")
    assert (status, "no statistics of VecNormalize at nowhere.pkl" in err) == (2, True)


def test_a_score_is_printed_before_its_page_is_made(monkeypatch, capsys, tmp_path):
    def broken(*_, **__):
        raise OSError("no space left for the page")

    monkeypatch.setattr(command, "write_page", broken)
    arguments = ("--agent", "pd", "--scenario", "hoop", "--report", str(tmp_path / "mine.html"))
    status, out, err = evaluate(monkeypatch, capsys, *arguments)
    assert status == 1
    assert "+52.9 %" in out
    assert "no space left for the page" in err


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("return 1 / 0", "PolicyFailed: hostile:policy failed: ZeroDivisionError: division by zero"),
        (
            "return observation[:, :3]",
            "hostile:policy returned actions of shape (1, 3) for 1 observations; wanted (1, 2)",
        ),
        (
            "return observation[:, :2] * float('nan')",
            "returned the action [nan, nan] for observation 0 of 1; both numbers must be finite",
        ),
        ("while True: pass", "no answer within 1 s; --timeout grants more"),
        ("import torch; return torch.ones(2)[:, None, None]", "returned actions of shape (2, 1, 1)"),
        ("import os; os._exit(3)", "ended without an answer, with exit code 3"),
    ],
)
def test_a_policy_that_misbehaves_is_reported(monkeypatch, capsys, tmp_path, body, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hostile.py").write_text(f"def policy(observation):\n    {body}\n")
    timeout = "1" if "while" in body else "60"
    status, out, err = evaluate(monkeypatch, capsys, "hostile:policy", "--scenario", "climb", "--timeout", timeout)
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
