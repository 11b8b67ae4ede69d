"""Corridors around flights in tables and figure: all measured rows are shown, and nothing that is not measured."""

from __future__ import annotations

import numpy as np
import pytest

from experiments import corridor_figure
from experiments.publishing.solvers import corridor_lines, corridors
from experiments.report.paper_charts import paper_charts


def line(height):
    """Return a level line of three points."""
    return [[x, height] for x in (0.0, 1.0, 2.0)]


@pytest.fixture
def rows():
    """A slalom in two corridors."""
    row = {"scenario": "slalom", "thrust_max_of_start": 16.0, "times_s": [4.0, 3.1, 3.003], "best_s": 3.0}
    return [
        row | {"flights_m": [line(z) for z in (0, 1, 2)], "outer_paths_m": [[line(0), line(1)], [line(1), line(3)]]}
    ]


def test_times_and_corridors_are_drawn(rows):
    figure = corridor_figure.corridors_figure(rows)
    traces = {trace.name: trace for trace in figure.data if trace.name}
    assert sorted(set(traces["last corridor"].y)) == [1, 3]
    assert traces["last corridor"].x[0] == traces["last corridor"].x[-1]
    assert list(traces["the last flight"].y) == [2, 2, 2]
    assert list(traces["the flight it starts from"].y) == [0, 0, 0]
    times = [list(trace.y) for trace in figure.data if trace.mode == "lines+markers"]
    assert times == [rows[0]["times_s"]]
    assert [3.0, 3.0] in [list(trace.y) for trace in figure.data]


def test_the_text_states_times_and_what_is_not_measured(rows):
    section = {"rows": rows, "date": "2026-01-02T00:00:00", "machine": {"cores": 2}, "processor": "A"}
    text = " ".join(corridors({"sections": {corridor_figure.SECTION: section}}).split())
    assert "`slalom` from 4.000 s to 3.0030 s, 0.10 % above T*" in text
    assert f"published/{corridor_figure.FILE})" in text
    assert corridors({"sections": {}}).startswith("Not measured yet. `flatquad measure solvers flat_convergence`")


def test_the_report_shows_the_corridors_that_are_measured(rows, monkeypatch):
    monkeypatch.setattr("experiments.paper.figures.pages", lambda _: {})
    assert paper_charts([]) == {}
    chart = paper_charts([], rows)["corridors"]
    assert "slalom" in chart.caption
    assert len(chart.figure["data"]) == len(corridor_figure.corridors_figure(rows).data)


def test_lines_of_the_table_state_the_worst_scenario_and_each_kind():
    flights = [
        {"certified": True, "processor_time_s": spent, "scenario": name, "above_best": gap}
        for name, gap, spent in (("hoop", 1e-3, 2.0), ("loop", 2e-3, 1.0))
    ]
    draws = {"kind": "random-goal", "scenarios": 100, "certified": 99}
    draws |= {"above_best_median": 1e-3, "above_best_largest": 0.004}
    lines = dict(corridor_lines({"flat_flights": flights, "flat_draws": [draws]}))
    assert list(lines.values()) == ["2 of 2, 0.20 % (`loop`)", "2.0 (`hoop`)", "99 of 100, 0.10 %, 0.40 %"]
    for row in flights:
        del row["processor_time_s"]
    assert list(dict(corridor_lines({"flat_flights": flights})).values()) == ["2 of 2, 0.20 % (`loop`)"]
    assert corridor_lines({}) == []
    assert np.size(corridor_lines({"flat_draws": [draws]})) == 2
