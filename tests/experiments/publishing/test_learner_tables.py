"""The tables of the agents state the scores of the results, with their intervals."""

import json
from copy import deepcopy

import pytest

from agents.evaluation.bootstrap import summary
from experiments.benchmark.agents import NAMES
from experiments.benchmark.formats import format_count
from experiments.benchmark.summary import episode_table, samples_to_target, summarise
from experiments.formats import format_percent
from experiments.publishing.figures.learners import picture
from experiments.publishing.learners import learners, median_samples
from experiments.publishing.policies import current_configs, pretrained, score_cells
from experiments.publishing.tables import demos

CONDITIONS = {"nominal": {}, "wind": {"wind": 0.5}, "delay": {"action_delay": 1}, "combined": {"mass": 0.025}}
K_STAR = {"hoop": [70, 70, 70, 70], "random-goal": [50, 60, 70, 80]}


def cell(problem, agent, seed=0, steps=None, curve=(), **others):
    """Return a cell as the study writes it; `steps` by condition, all others as nominal ones."""
    steps = steps or {}
    flown = {name: {"steps": steps.get(name, steps.get("nominal", K_STAR[problem]))} for name in CONDITIONS}
    costs = {"env_steps": 0, "expert_labels": 0, "training_s": 0.0, "planning_s": 0.25, "date": "2001-02-03T04"}
    return {"problem": problem, "agent": agent, "seed": seed, "episodes": flown, "curve": list(curve)} | costs | others


def point(steps, success_rate, env_steps, expert_labels=0):
    """Return a point of a learning curve."""
    samples = {"env_steps": env_steps, "expert_labels": expert_labels, "wall_time_s": env_steps / 1e4}
    return samples | {"success_rate": success_rate, "steps": steps}


@pytest.fixture
def results():
    """A study of two problems, with agents of every kind."""
    curve = [point(200, 0.0, 10_000), point(90, 1.0, 40_000), point(72, 1.0, 1_500_000)]
    shown = [point(70, 1.0, 12_000, 15_000)]
    cells = [
        cell("random-goal", "pd", steps={"nominal": [70, 84, 98, 112]}),
        cell("hoop", "open-loop", steps={"wind": [70, None, None, None]}),
        cell("hoop", "expert", steps={"wind": [72, 73, 74, 75]}),
        cell("random-goal", "ppo", 0, {"nominal": [55, 66, None, 88]}, curve, env_steps=2_000_000, training_s=250.0),
        cell("random-goal", "ppo", 1, {"nominal": [51, 61, 71, 81]}, curve[:2], env_steps=2_000_000, training_s=250.0),
        cell("hoop", "dagger", 0, {"nominal": [70, 70, 70, 70]}, shown, env_steps=12_000, expert_labels=15_000),
        cell("hoop", "sac", 0, {"nominal": [None] * 4}, curve[:1], env_steps=140_000),
    ]
    return {
        "smoke": False,
        "date": "2001-02-04T05",
        "versions": {"flatgym": "1", "stable-baselines3": "2", "torch": "3"},
        "machine": {"processor": "p", "system": "s", "cores": 2},
        "conditions": CONDITIONS,
        "k_star": K_STAR,
        "validation_k_star": {"hoop": 70.0, "random-goal": 66.0},
        "cells": cells,
    }


def lines(text, which=0):
    """Return the cells of a table below its head."""
    tables = [part.splitlines()[2:] for part in text.split("\n\n") if part.startswith("| ")]
    return [line.strip("| ").split(" | ") for line in tables[which]]


def words(text):
    """Return a text without its line breaks."""
    return " ".join(text.split())


def test_learners_have_a_line_with_their_gaps_by_work(results):
    samples = {tuple(line[:2]): line[2:5] for line in lines(learners(results), 1)}
    assert samples == {
        ("`hoop`", "SAC"): ["-", "-", "-"],
        ("`hoop`", "DAgger"): ["**+0.0 %**"] * 3,
        ("`random-goal`", "PPO"): ["**+36.4 %**", "**+36.4 %**", "**+22.7 %**"],
    }


def test_every_agent_has_a_line_in_both_tables_in_the_order_of_names(results):
    text = learners(results)
    wanted = [("`hoop`", name) for name in ("SAC", "DAgger", "expert", "open-loop replay")]
    wanted += [("`random-goal`", name) for name in ("PPO", "cascaded PD")]
    for which in (0, 2):
        assert [tuple(line[:2]) for line in lines(text, which)] == wanted


def test_scores_are_those_of_the_intervals_over_seeds_and_flights(results):
    rows = episode_table(results)
    ppo = rows[(rows["agent"] == "ppo") & (rows["condition"] == "nominal")]
    (wanted,) = summary(ppo).to_dict("records")
    found = summarise(results)["random-goal", "ppo", "nominal"]
    assert {key: found[key] for key in wanted} == wanted
    assert (found["runs"], found["episodes"], found["success_rate"]) == (2, 8, 7 / 8)
    line = next(line for line in lines(learners(results)) if line[1] == "PPO")
    low, high = 100 * wanted["success_low"], 100 * wanted["success_high"]
    assert line[2] == f"88 % [{low:.0f}, {high:.0f}]"
    assert line[4:] == ["2.00 M", "-", "250", "1.50 M (1/2)"]


def test_gaps_are_to_each_flights_own_optimum(results):
    rows = episode_table(results)
    assert rows[rows["agent"] == "pd"]["gap"].tolist() == pytest.approx([0.4] * 4 * len(CONDITIONS))
    assert rows[rows["outcome"] == "failed"]["gap"].isna().all()


def test_experts_have_no_training_cost_and_failed_agents_no_gap(results):
    table = {line[1]: line for line in lines(learners(results))}
    assert table["expert"][4:] == ["-"] * 4
    assert table["SAC"][2:4] == ["0 %", "-"]
    assert table["SAC"][-1] == "never"


def test_feedback_is_better_only_where_its_interval_lies_above(results):
    assert "On `hoop` the expert's feedback is better than open-loop replay under wind." in words(learners(results))
    assert "A pure delay does not affect open-loop replay" in words(learners(results))
    open_loop = next(one for one in results["cells"] if one["agent"] == "open-loop")
    open_loop["episodes"]["delay"]["steps"] = [None, 71, 71, 71]
    open_loop["episodes"]["wind"]["steps"] = [72, 72, 72, 72]
    assert "is better than open-loop replay under none." in words(learners(results))
    assert "A pure delay" not in words(learners(results))


def test_small_sizes_are_stated(results):
    assert "numbers mean nothing" not in words(learners(results))
    assert "numbers mean nothing" in words(learners(results | {"smoke": True}))


def test_samples_are_counted_until_success_and_gap_reach_their_targets():
    curve = [point(75, 0.5, 1000, 5), point(80, 1.0, 2000, 5), point(76, 0.9, 3000, 5), point(70, 1.0, 4000, 5)]
    assert samples_to_target({"curve": curve}, 70.0) == 3005
    assert median_samples([3005.0, float("nan"), 5005.0]) == "4.0 k (2/3)"
    assert median_samples([float("nan")]) == "never"


@pytest.mark.parametrize(
    ("rate", "text"), [(1, "100 %"), (0.9994, "99.9 %"), (0.875, "88 %"), (0.001, "0.1 %"), (0, "0 %")]
)
def test_only_exact_rates_are_0_or_100_percent(rate, text):
    assert format_percent(rate) == text


def test_amounts_have_units():
    assert [format_count(count) for count in (0, 4599, 1_500_000)] == ["-", "4.6 k", "1.50 M"]


def test_the_figure_shows_every_agent_and_every_learning_curve(results):
    shown = picture(results)
    names = {trace.y[0] for trace in shown.data if trace.type == "bar"}
    assert names <= set(NAMES.values())
    curves = [trace for trace in shown.data if trace.type == "scatter" and trace.mode == "lines+markers"]
    assert [len(trace.x) for trace in curves] == [0, 1, 2, 1]
    best = curves[2]
    assert list(best.y) == pytest.approx([90 / 66 - 1, 72 / 66 - 1])
    before = deepcopy(results)
    picture(results)
    assert results == before


def test_pretrained_policies_are_listed_with_score_and_command(tmp_path):
    score = {"algorithm": "DAgger", "success_rate": 1.0, "steps": 70.0, "k_star": 70, "gap": 0.0}
    card = {"command": "flatquad pretrain hoop --seed 3", "seed": 3, "commit": "0123456789abcdef", "configs": []}
    card |= {"score": score | {"env_steps": 12_988, "wall_time_s": 25.5}}
    (tmp_path / "hoop.json").write_text(json.dumps(card))
    (tmp_path / "hoop.zip").write_bytes(bytes(123_456))
    text = pretrained(tmp_path)
    assert lines(text) == [["`hoop`", "DAgger", "100 %", "70", "70", "+0.0 %", "13.0 k", "26", "123"]]
    command = "`flatquad pretrain NAME --seed 3` trains each of them."
    assert " ".join(text.split()).endswith(
        f"{command} `hoop` has the recipe of commit 0123456; today's recipe differs."
    )
    (tmp_path / "hoop.json").write_text(json.dumps(card | {"configs": current_configs("hoop", card)}))
    assert pretrained(tmp_path).endswith(command)
    earlier = [
        {k: v for k, v in one.items() if k != "bins"} | {"max_seconds": 90.0} for one in current_configs("hoop", card)
    ]
    for seconds, same in ((26.0, True), (90.0, False)):
        score = card["score"] | {"wall_time_s": seconds}
        (tmp_path / "hoop.json").write_text(json.dumps(card | {"configs": earlier, "score": score}))
        assert pretrained(tmp_path).endswith(command) == same
    failed = score_cells({"score": card["score"] | {"steps": None, "gap": None, "success_rate": 0.0}})
    assert failed[1:5] == ["0 %", "-", "70", "-"]


def test_demonstrations_have_a_line_for_each_section():
    row = {
        "what": "random-goal", "flights": 1000, "processes": 2, "per_second": 21.04, "proven": 0.0, "mean_steps": 70.31,
        "replayed_to_goal": 0.999, "bytes_per_flight": 9000.0,
    }  # fmt: skip
    sections = {name: {"rows": [row], "date": "2001-02-03T04"} for name in ("random-goal", "perturbed")}
    found = lines(demos({"sections": sections}))
    assert found[0] == ["`random-goal`", "1,000", "21.0", "0 %", "70.3", "99.9 %", "9.0"]
    assert found[1][0] == "perturbed, `random-goal`"
