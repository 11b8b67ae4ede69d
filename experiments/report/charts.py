"""Charts of a problem: gaps, learning curves and robustness, as data for the page's script.

A chart has no width of its own. Its height follows the number of its rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import isnan
from typing import Any

import plotly.graph_objects as go

from experiments.benchmark.formats import describe_disturbances
from experiments.benchmark.leaderboard import ConditionScore, Curve, Leaderboard, LeaderboardRow
from experiments.benchmark.summary import TARGET_SUCCESS
from experiments.figures import COLOURS, FLAME, INK
from experiments.report.chart_style import (
    EXTERNAL_COLOURS,
    agent_colours,
    error_bars,
    label,
    plain_figure,
    use_name_axis,
)

SYMBOLS = ("circle", "diamond", "square", "triangle-up", "x", "star")
"""Markers of the conditions."""
Conditions = Mapping[str, Mapping[str, float]]
"""Strengths of the active disturbances, by condition."""


@dataclass(frozen=True)
class Chart:
    """A figure of the page.

    Attributes:
        caption: text below it, HTML.
        description: the same for screen readers, plain text.
        figure: data and layout, as Plotly's JSON.
        height: largest height [px].
        aspect: ratio of height to width, for a height below `height`; 0 for a fixed height.
        min_width: width below which it scrolls and does not shrink [px].
    """

    caption: str
    description: str
    figure: dict[str, Any]
    height: int
    aspect: float = 0.0
    min_width: int = 0


def problem_charts(leaderboard: Leaderboard, problem: str, conditions: Conditions) -> dict[str, Chart]:
    """Return the charts of a problem: "gap", and "learning" and "robustness" where there are data."""
    curves = [curve for curve in leaderboard.curves if curve.problem == problem]
    scores = [score for score in leaderboard.scores if score.problem == problem]
    charts = {"gap": gap_chart(problem, [row for row in leaderboard.rows if row.problem == problem])}
    if curves:
        charts["learning"] = learning_chart(problem, curves)
    if scores and len(conditions) > 1:
        charts["robustness"] = robustness_chart(problem, scores, conditions)
    return charts


def gap_chart(problem: str, rows: Sequence[LeaderboardRow]) -> Chart:
    """Return the gaps of all agents on a problem, with intervals; an agent without a gap has a note instead."""
    colours, names = agent_colours(row.agent for row in rows), [label(row.name) for row in rows]
    known = [row for row in rows if not isnan(row.gap)]
    figure = go.Figure()
    figure.add_scatter(
        x=[row.gap for row in known], y=[label(row.name) for row in known], mode="markers", showlegend=False,
        marker={"size": 10, "color": [colours[row.agent] for row in known]},
        error_x=error_bars([x.gap for x in known], [x.gap_low for x in known], [x.gap_high for x in known]),
        customdata=[[row.gap_low, row.gap_high] for row in known],
        hovertemplate="%{y}: %{x:.1%}, 95 % interval %{customdata[0]:.1%} to %{customdata[1]:.1%}<extra></extra>",
    )  # fmt: skip
    for row in rows:
        if isnan(row.gap):
            figure.add_annotation(
                x=0, y=label(row.name), text=no_gap_note(row), showarrow=False,
                xanchor="left", xshift=8, font={"color": COLOURS[1]},
            )  # fmt: skip
    figure.add_vline(x=0, line={"color": INK, "width": 1.5})
    top = max([0.05, *(row.gap_high for row in known), *(row.gap for row in known)])
    figure.update_xaxes(title="gap to K*", tickformat=".0%", range=[-0.03 * top, 1.06 * top], zeroline=False)
    use_name_axis(figure, names)
    caption = f"<b>{escape(problem)}</b>: gap to K*, interquartile mean with 95 % bootstrap interval"
    return Chart(caption, f"{problem}: gap to K*", plain_figure(figure), 80 + 28 * max(len(rows), 2))


def no_gap_note(row: LeaderboardRow) -> str:
    """Return why an agent has no gap."""
    if row.failed:
        return "failed"
    return "K* unknown" if row.success else "no success"


def learning_chart(problem: str, curves: Sequence[Curve]) -> Chart:
    """Return the learning curves of all runs on a problem."""
    colours, figure, in_legend = agent_colours(curve.agent for curve in curves), go.Figure(), set()
    for curve in curves:
        if not curve.samples:
            continue
        figure.add_scatter(
            x=curve.samples, y=curve.gaps, mode="lines+markers", name=label(curve.name), legendgroup=curve.agent,
            showlegend=curve.agent not in in_legend, marker={"size": 5},
            line={"color": colours[curve.agent], "width": 1.8, "shape": "hv"},
            hovertemplate=f"{label(curve.name)}, seed {curve.seed}: %{{y:.1%}} after %{{x:.3s}}<extra></extra>",
        )  # fmt: skip
        in_legend.add(curve.agent)
    figure.add_hline(y=0, line={"color": INK, "width": 1.5, "dash": "dot"})
    figure.add_annotation(text="K*", x=1, xref="paper", y=0, yanchor="bottom", showarrow=False, font={"color": INK})
    figure.update_xaxes(title="samples (env steps + expert labels)", type="log", exponentformat="SI", dtick="D2")
    most = max((gap for curve in curves for gap in curve.gaps), default=0.0)
    figure.update_yaxes(title="gap to K*", tickformat=".0%", range=[-0.015, max(0.05, min(0.6, 1.08 * most))])
    figure.update_layout(legend={"orientation": "h", "y": -0.28, "yanchor": "top", "x": 0})
    caption = (
        f"<b>{escape(problem)}</b>: smallest gap in validation so far, one line for each training run; only "
        f"validations with {100 * TARGET_SUCCESS:.0f} % success count, and a run without one has no line"
    )
    return Chart(caption, f"{problem}: learning curves", plain_figure(figure), 360)


def robustness_chart(problem: str, scores: Sequence[ConditionScore], conditions: Conditions) -> Chart:
    """Return the success of all agents on a problem under each condition, with intervals."""
    figure, names = go.Figure(), list(dict.fromkeys(label(score.name) for score in scores))
    colours = [*COLOURS, FLAME, *EXTERNAL_COLOURS]
    for i, (condition, active) in enumerate(conditions.items()):
        some, colour = [score for score in scores if score.condition == condition], colours[i % len(colours)]
        figure.add_scatter(
            x=[score.success for score in some], y=[label(score.name) for score in some], mode="markers",
            name=escape(condition), orientation="h", offsetgroup=condition,
            marker={"size": 8, "symbol": SYMBOLS[i % len(SYMBOLS)], "color": colour},
            error_x=error_bars([x.success for x in some], [x.success_low for x in some], [x.success_high for x in some])
            | {"width": 2, "thickness": 1, "color": colour},
            hovertemplate=f"%{{y}}, {escape(describe_disturbances(dict(active)) or condition)}: %{{x:.1%}}"
            "<extra></extra>",
        )  # fmt: skip
    figure.update_xaxes(title="success", tickformat=".0%", range=[-0.02, 1.03], tickvals=[0, 0.25, 0.5, 0.75, 1])
    use_name_axis(figure, names)
    figure.update_layout(
        scattermode="group", scattergap=0.25,
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0},
    )  # fmt: skip
    caption = f"<b>{escape(problem)}</b>: success under each condition, with 95 % bootstrap intervals"
    height = 120 + 13 * max(len(names), 2) * max(len(conditions), 2)
    return Chart(caption, f"{problem}: success under disturbances", plain_figure(figure), height)
