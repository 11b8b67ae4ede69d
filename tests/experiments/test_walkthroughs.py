"""The walk-throughs run from top to bottom, and their results are consistent.

A test runs a script in a temporary folder and examines its variables.
"""

import json
import math
import re
import runpy
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from agents import policies
from experiments import walkthroughs
from experiments.figures import Track
from flatgym.scenarios.reference import reference
from optimal.flights.certificate import TOLERANCE
from optimal.flights.replay import REPLAY_TOLERANCE

NAMES = ("control", "imitation", "planning", "reinforcement", "tensors")
SOURCES = {name: Path(walkthroughs.__path__[0], f"{name}.py").read_text(encoding="utf-8") for name in NAMES}
WALKTHROUGH_RESULTS = Path("experiments/results/walkthroughs")


@pytest.fixture(scope="module")
def left(tmp_path_factory):
    """Run a walk-through at small size, once; return the names it leaves, its folder and what it prints."""
    known = {}

    def run(name, capsys):
        if name not in known:
            folder, threads = tmp_path_factory.mktemp(name), torch.get_num_threads()
            with pytest.MonkeyPatch.context() as patch:
                patch.chdir(folder)
                patch.setattr("sys.argv", [name, "--quick"])
                patch.setenv("MINARI_DATASETS_PATH", str(folder / "minari"))
                names = runpy.run_module(f"experiments.walkthroughs.{name}", run_name="__main__")
            torch.set_num_threads(threads)
            known[name] = names, folder / WALKTHROUGH_RESULTS / name, capsys.readouterr().out
        return known[name]

    return run


@pytest.mark.parametrize("name", NAMES)
def test_it_reads_as_a_notebook(name):
    cells = re.split(r"^# %%", SOURCES[name], flags=re.MULTILINE)
    assert cells[0] == ""
    prose = [cell for cell in cells[1:] if cell.startswith(" [markdown]\n")]
    code = [cell for cell in cells[1:] if cell.startswith("\n")]
    assert len(prose) + len(code) == len(cells) - 1
    assert all(line.startswith("#") for cell in prose for line in cell.strip().splitlines()[1:] if line)
    assert prose[0].splitlines()[1].startswith("# # ")
    assert all(cell.splitlines()[1].startswith("# ## ") for cell in prose[1:])
    for cell in code:
        compile(cell, name, "exec")  # a cell runs alone: no block goes on in the next


@pytest.mark.parametrize("name", NAMES)
def test_it_ends_with_pictures_and_a_sentence(left, name, capsys):
    names, folder, printed = left(name, capsys)
    assert printed.splitlines()[-1] == names["conclusion"]
    assert re.search(r"\d", names["conclusion"])
    assert "nan" not in names["conclusion"]
    assert (folder / "paths.html").stat().st_size > 1000
    assert all(isinstance(track, Track) for track in names["tracks"])


def test_no_number_of_a_result_is_typed():
    for name, source in SOURCES.items():
        said = "".join(line for line in source.splitlines(keepends=True) if line.startswith("# ") and "%%" not in line)
        assert not re.search(r"\d+\.\d|\d %", said), name


def test_control_solves_certifies_and_proves(left, capsys):
    names, folder, _ = left("control", capsys)
    solution, proof, best = names["solution"], names["proof"], names["best"]
    certificate = solution.certificate
    assert certificate.max_control_violation <= TOLERANCE
    assert certificate.max_path_violation <= TOLERANCE
    assert max(certificate.replay_error, certificate.terminal_error) <= REPLAY_TOLERANCE
    assert certificate.hoop_clearance >= -TOLERANCE
    assert names["passes"].holds()
    assert not names["misses"].holds()
    assert 0 < proof.time <= solution.time
    assert proof.check()
    assert names["info"]["outcome"] == "goal"
    assert best.lower_bound <= best.steps == names["info"]["steps"]
    table = pd.read_csv(folder / "window.csv")
    assert table["t_s"].iloc[-1] == solution.time
    np.testing.assert_allclose(table[["x_m", "z_m"]].iloc[-1], solution.scenario.goal, atol=REPLAY_TOLERANCE)


def test_control_compares_methods_that_agree_and_a_hoop_costs_time(left, capsys):
    names, _, _ = left("control", capsys)
    open_air = names["methods"].set_index(["scenario", "method"])["time_s"]["open-air"]
    assert set(open_air.index) == {"shooting", "flat", "pontryagin"}
    assert open_air["pontryagin"] == pytest.approx(open_air["shooting"], rel=1e-3)
    assert open_air["shooting"] / (1 + 1e-3) <= open_air["flat"] <= 1.02 * open_air["shooting"]
    assert names["solution"].time > open_air.min()


def test_imitation_records_what_replays_and_saves_what_loads(left, capsys):
    names, folder, _ = left("imitation", capsys)
    assert {(one.outcome, one.steps - one.k_star) for one in names["replays"]} == {("goal", 0)}
    assert names["k_star"] == reference(names["NAME"]).k_star
    assert len(names["expert_data"].actions) == names["dataset"].total_steps
    for file, model in (("cloned.zip", "cloned"), ("dagger.zip", "dagger_policy")):
        loaded = policies.load(folder / file, trust=True)
        actions = [
            one.predict(names["expert_data"].observations, deterministic=True)[0] for one in (loaded, names[model])
        ]
        np.testing.assert_array_equal(*actions)


def test_imitation_scores_no_policy_better_than_the_expert(left, capsys):
    table = left("imitation", capsys)[0]["table"].set_index("agent")
    assert table.loc["expert", "gap"] == 0
    assert (table["gap"].dropna() >= 0).all()
    assert (table["gap"].isna() == (table["success"] == 0)).all()
    assert table["success in wind"].between(0, 1).all()


def test_reinforcement_scores_against_k_star(left, capsys):
    names, folder, _ = left("reinforcement", capsys)
    scores = names["scores"].set_index("agent")
    assert (scores["k_star"] == names["best"].k_star).all()
    assert scores.loc["pretrained", "success_rate"] == 1
    for gap, success in zip(scores["gap"], scores["success_rate"], strict=True):
        assert gap >= 0 if success else math.isnan(gap)
    assert len(names["tracks"][0].time) - 1 == names["best"].k_star
    assert json.loads((folder / "ppo" / "config.json").read_text())["scenario"] == names["NAME"]


@pytest.mark.parametrize("name", ["planning", "tensors"])
def test_the_examples_for_tensors_are_short_and_score_against_k_star(left, name, capsys):
    names, _, _ = left(name, capsys)
    assert len(SOURCES[name].splitlines()) < 150
    assert len(names["tracks"][0].time) - 1 == names["best"].k_star == reference(names["NAME"]).k_star
    assert f"K* = {names['best'].k_star}" in names["conclusion"]


def test_planning_descends(left, capsys):
    losses = left("planning", capsys)[0]["losses"]
    assert np.isfinite(losses).all()
    assert np.min(losses) < 5  # a random plan misses the goal by many tolerances: thousands


def test_ppo_on_tensors_learns_from_finite_numbers(left, capsys):
    names, _, _ = left("tensors", capsys)
    assert all(parameter.isfinite().all() for parameter in names["parameters"])
    assert names["score"]["k_star"] == names["best"].k_star
