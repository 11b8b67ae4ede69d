"""The leaderboard holds every cell, its intervals against K*, and every failure."""

import pytest

from agents.evaluation.bootstrap import summary
from experiments.benchmark.leaderboard import Leaderboard
from experiments.benchmark.summary import episode_table
from experiments.files import plain
from experiments.report.charts import problem_charts
from flatgym.scenarios.reference import reference


def test_every_cell_has_a_row_whether_its_agent_is_known_or_not(benchmark, numbers, evil):
    wanted = {(cell["problem"], cell["agent"]) for cell in benchmark["cells"]}
    rows = [(row["problem"], row["agent"]) for row in numbers["leaderboard"]]
    assert set(rows) == wanted
    assert len(rows) == len(wanted)
    names = [row["name"] for row in numbers["leaderboard"] if row["problem"] == "hoop"]
    assert names == [evil, "mine", "theirs", "PPO", "SAC", "cascaded PD"]


def test_scores_and_intervals_are_those_of_the_episodes(benchmark, numbers):
    episodes = episode_table(benchmark | {"cells": [cell for cell in benchmark["cells"] if cell["episodes"]]})
    for row in numbers["leaderboard"]:
        nominal = episodes[(episodes["scenario"] == row["problem"]) & (episodes["agent"] == row["agent"])]
        nominal = nominal[nominal["condition"] == "nominal"]
        if len(nominal):
            (wanted,) = plain(summary(nominal).to_dict("records"))
            found = {"success_rate": row["success"]} | row
            assert {key: found[key] for key in wanted if key in found} == {k: wanted[k] for k in wanted if k in found}
    pd = next(row for row in numbers["leaderboard"] if row["agent"] == "pd")
    assert pd["gap"] == pytest.approx(pd["steps"] / reference("hoop").k_star - 1)


def test_failures_are_reported_and_not_dropped(document, numbers, failure):
    rows = {row["agent"]: row for row in numbers["leaderboard"]}
    assert rows["theirs"]["errors"] == [f"seed 0: {failure}"]
    assert rows["theirs"]["episodes"] == 0
    assert rows["mine"]["errors"] == [f"seed 1: {failure}"]
    assert rows["mine"]["episodes"] > 0
    assert document.words.count(f"seed 0: {failure}") == document.words.count(f"seed 1: {failure}") == 1
    assert document.words.count("failed") == 1


def test_a_study_whose_cells_all_failed_has_a_report(benchmark):
    found = Leaderboard.of(benchmark | {"cells": [cell for cell in benchmark["cells"] if not cell["episodes"]]})
    assert [row.failed for row in found.rows] == [True, True]
    assert not found.scores
    assert not found.curves
    assert list(problem_charts(found, "hoop", benchmark["conditions"])) == ["gap"]
