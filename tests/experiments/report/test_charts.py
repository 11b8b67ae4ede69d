"""Charts name all agents, escaped and shortened, and do without known gaps."""

import math
from dataclasses import replace

from experiments.benchmark.leaderboard import Leaderboard
from experiments.report import page
from experiments.report.chart_style import DARK, agent_colours, label
from experiments.report.charts import gap_chart
from experiments.report.elements import TableCell


def test_names_are_escaped_and_shortened_for_plotly():
    assert label("<a href='x'>") == "&lt;a href=&#x27;x&#x27;&gt;"
    assert label("long" * 99).endswith("…")
    assert set(agent_colours(["ppo", "pd", "mine"]).values()) <= set(DARK)


def test_every_agent_has_a_row_in_the_gap_chart(benchmark):
    rows = [row for row in Leaderboard.of(benchmark).rows if row.problem == "hoop"]
    chart = gap_chart("hoop", rows)
    points, notes = chart.figure["data"][0]["y"], [note["text"] for note in chart.figure["layout"]["annotations"]]
    assert len(points) + len(notes) == len(rows)
    assert notes == ["failed", "no success"]


def test_unknown_k_star_and_conditions_are_shown(benchmark):
    row = Leaderboard.of(benchmark).rows[0]
    unknown = replace(row, gap=math.nan, k_star=math.nan)
    assert page.leaderboard_cells(unknown)[5] == TableCell("-", None)
    assert gap_chart("hoop", [unknown]).figure["layout"]["annotations"][0]["text"] == "K* unknown"
    assert page.describe_conditions({"nominal": {}, "gusts": {"gusts": 0.5}}).endswith("for all agents: gusts 0.5.")
    assert page.describe_conditions({"nominal": {}}) == ""
