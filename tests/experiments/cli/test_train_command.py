"""The command `flatquad train`: what it prints is what was trained, and it goes on where it stopped."""

import json

import pytest
from typer.testing import CliRunner

from agents.evaluation.optima import best_known
from agents.policies import describe
from agents.training.configs import from_json
from experiments.cli import app
from flatgym import Hoop, Scenario, reference
from flatgym.scenarios import catalogue
from tests.experiments.cli.shell import flatquad

SHORT = ("train", "horizontal-3", "--env-steps", "16384", "--seconds", "100000", "--json")


def test_help_has_an_example():
    result = CliRunner().invoke(app.app, ["train", "--help"])
    assert result.exit_code == 0
    assert "flatquad train hoop" in result.output
    assert "--json" in result.output


def test_it_trains_and_resumes(monkeypatch, capsys, tmp_path):
    status, out, _ = flatquad(monkeypatch, capsys, *SHORT, "--seed", "3", "--folder", str(tmp_path))
    assert status == 0
    (row,) = json.loads(out)
    assert (row["scenario"], row["algorithm"], row["seed"], row["k_star"]) == ("horizontal-3", "PPO", 3, 44)
    assert (row["env_steps"], row["model"]) == (16384, str(tmp_path / "model.zip"))
    assert (row["success_rate"] > 0) == (row["steps"] is not None) == (row["gap"] is not None)
    config = from_json((tmp_path / "config.json").read_text())
    assert (config.seed, config.env_steps, config.max_seconds) == (3, 16384, 1e5)
    before = (tmp_path / "model.zip").read_bytes()
    status, _, err = flatquad(monkeypatch, capsys, *SHORT, "--seed", "3", "--folder", str(tmp_path))
    assert status == 2
    assert "holds model.zip and checkpoint.pt of an earlier training: continue it with --resume" in err
    assert (tmp_path / "model.zip").read_bytes() == before
    status, out, _ = flatquad(monkeypatch, capsys, *SHORT, "--seed", "3", "--folder", str(tmp_path), "--resume")
    assert (status, json.loads(out)[0]["env_steps"]) == (0, 16384)
    assert (tmp_path / "model.zip").read_bytes() == before


def test_resuming_without_a_checkpoint_is_refused_at_once(monkeypatch, capsys, tmp_path):
    folder = tmp_path / "nothere"
    status, _, err = flatquad(monkeypatch, capsys, "train", "hoop", "--resume", "--folder", str(folder))
    assert status == 2
    assert "checkpoint.pt does not exist: there is no training to resume; leave out --resume" in err
    assert not folder.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("hoop", "--resume", "--overwrite"), "give one of them"),
        (("hoop", "--algorithm", "pp"), "did you mean 'PPO'?"),
        (("hop",), "did you mean 'hoop'"),
        (("hoop", "--algorithm", "a3c"), "known: PPO, SAC, TD3, TQC"),
        (("hoop", "--seconds", "-1"), "PPOConfig.max_seconds must be positive"),
        (("hoop", "--policy", "nowhere.zip"), "PPOConfig.policy must be a file"),
    ],
)
def test_bad_arguments_are_refused_with_a_reason(monkeypatch, capsys, tmp_path, arguments, words):
    status, _, err = flatquad(monkeypatch, capsys, "train", *arguments, "--folder", str(tmp_path))
    assert status == 2
    assert words in " ".join(err.split())
    assert list(tmp_path.iterdir()) == []


def test_an_own_track_is_trained_by_its_content_and_scored_against_its_k_star(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    track = Scenario("hoop", (0, 0), (2, 0), hoops=(Hoop(1, 0, 1),))  # not the built-in `hoop`
    path, folder = tmp_path / "track.json", tmp_path / "run"
    path.write_text(track.to_json())
    arguments = ("train", str(path), "--env-steps", "16384", "--seconds", "100000", "--folder", str(folder), "--json")
    status, out, err = flatquad(monkeypatch, capsys, *arguments)
    assert status == 0, err
    (row,) = json.loads(out)
    known = best_known(track, tmp_path / "cache" / "flatquad")
    assert (row["scenario"], row["k_star"]) == (f"hoop-{track.digest[:8]}", known.k_star)
    assert reference("hoop").k_star != known.k_star
    path.unlink()  # the model holds the content, not the path
    assert catalogue.problem(from_json((folder / "config.json").read_text()).scenario) == track
    assert catalogue.problem(describe(folder / "model.zip")["scenario"]) == track
