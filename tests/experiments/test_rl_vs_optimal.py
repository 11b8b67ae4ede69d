"""The whole benchmark at small size: every stage runs, and every number in the results came from it."""

import csv
import json
from dataclasses import replace

import joblib
import numpy as np
import pytest
from rich.console import Console
from rich.progress import Progress

from agents.configs import PPOConfig
from experiments import rl_vs_optimal
from experiments.files import SCHEMA
from flatgym import OUTCOMES, SCENARIOS
from flatgym.task import fly_actions


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("results")
    with pytest.MonkeyPatch.context() as patch, Progress(console=Console(quiet=True)) as bar:
        patch.setenv("MINARI_DATASETS_PATH", str(tmp_path_factory.mktemp("datasets")))
        patch.setattr(rl_vs_optimal, "DEMONSTRATIONS", 2)
        patch.setattr(
            rl_vs_optimal, "PPOConfig", lambda **given: replace(PPOConfig(num_envs=16, rollout=32, batch=512), **given)
        )
        with joblib.parallel_config(backend="threading"):
            results = rl_vs_optimal.run(
                out, scenarios=("horizontal-3",), seconds=3.0, seed=0, command="flatquad benchmark", bar=bar
            )
    return out, results


def test_results_are_on_disk_as_returned(run):
    out, results = run
    stored = json.loads((out / "benchmark.json").read_text())
    assert stored["schema"] == SCHEMA
    assert stored["command"] == results["command"] == "flatquad benchmark"
    (row,) = stored["scores"]
    (line,) = csv.DictReader((out / "scores.csv").read_text().splitlines())
    assert row["k_star"] == int(line["k_star"]) == 44
    assert row["outcomes"].keys() <= set(OUTCOMES)
    assert 0 < row["env_steps"] == stored["curves"]["horizontal-3"][-1]["env_steps"]


def test_the_flights_in_the_results_replay(run):
    _, results = run
    optimal, ppo = (np.array(results["flights"]["horizontal-3"][who], dtype=np.float32) for who in ("optimal", "ppo"))
    assert OUTCOMES[fly_actions(SCENARIOS["horizontal-3"], optimal)[-1].outcome[0]] == "goal"
    flown = fly_actions(SCENARIOS["horizontal-3"], ppo)
    assert len(flown) == len(ppo) + 1
    assert OUTCOMES[flown[-1].outcome[0]] in results["scores"][0]["outcomes"]


def test_figures_are_drawn(run):
    out, _ = run
    pages = {page.name for page in out.glob("*.html")}
    assert pages == {f"horizontal-3-{kind}.html" for kind in ("paths", "controls", "learning")}
    assert (out / "plotly.min.js").stat().st_size > 1_000_000
