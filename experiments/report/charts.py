"""The figures of the report: gaps, learning, robustness, and the paper's, as data that the page's script draws.

Names of agents are escaped: Plotly reads a little HTML in what it writes. A figure has no width of its own, its
height follows the lines in it or, for a map of the world, the width; colours are those of the light theme, and DARK
says what each becomes at night.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import isnan
from typing import Any

import plotly.graph_objects as go

from experiments.benchmark.agents import PAINT
from experiments.benchmark.formats import strength
from experiments.benchmark.leaderboard import ConditionScore, Curve, Leaderboard, LeaderboardRow
from experiments.benchmark.summary import RELIABLE
from experiments.figures import COLOURS, FAINT, FLAME, INK, OUTLINE
from experiments.paper import figures

MORE = ("#12807a", "#b0487f", "#5a67c4", "#8a6d1f")
"""Colours of agents that are not of the study."""
DARK = {
    INK: "#dbe4ec",
    OUTLINE: "#84929e",
    FAINT: "#2a343d",
    FLAME: "#f0b352",
    "white": "#12171c",
    **dict(zip(COLOURS, ("#55b7e0", "#f08a68", "#93c267", "#c795d6"), strict=True)),
    **dict(zip(MORE, ("#4cc2ba", "#e585b6", "#98a2f0", "#cfae58"), strict=True)),
}
"""What a colour of the light theme is in the dark one."""
LABEL = 26
"""Most letters of a name beside an axis."""
SUBPLOT = {"size": 16}
"""Letters of Plotly's titles of subplots, too large for a phone."""
SYMBOLS = ("circle", "diamond", "square", "triangle-up", "x", "star")
SQUARE = ("figure-4", "figure-5")
"""Maps of the world that are as high as wide."""


@dataclass(frozen=True)
class Chart:
    """A figure to draw.

    Attributes:
        caption: what stands below it, HTML.
        words: the same for who cannot see it, plain.
        figure: data and layout, as Plotly's JSON.
        height: [px].
        aspect: height by width where that is less than `height`; 0 for a height that stays.
        least: width below which it is scrolled and not shrunk [px].
    """

    caption: str
    words: str
    figure: dict[str, Any]
    height: int
    aspect: float = 0.0
    least: int = 0


def colours(agents: Iterable[str]) -> dict[str, str]:
    """Return the colours of agents: those of the study's as in its tables, grey for what did not learn, others new."""
    known = dict.fromkeys(agents)
    new = [agent for agent in known if agent not in PAINT and agent not in GREY]
    fresh = {agent: MORE[i % len(MORE)] for i, agent in enumerate(new)}
    return {agent: PAINT.get(agent) or fresh.get(agent, OUTLINE) for agent in known}


GREY = ("expert", "expert-rim", "replanner", "tape", "pd")
"""Agents of the study that do not learn."""


def label(name: str) -> str:
    """Return a name as Plotly can write it beside an axis."""
    return escape(name if len(name) <= LABEL else name[: LABEL - 1] + "…")


def drawn(figure: go.Figure) -> dict[str, Any]:
    """Return a figure as plain data without title, template and width, which are the page's."""
    data: dict[str, Any] = json.loads(figure.to_json())
    for key in ("template", "title", "width", "height", "font", "margin"):
        data["layout"].pop(key, None)
    for note in data["layout"].get("annotations", ()):
        if note.get("font") == SUBPLOT:
            del note["font"]
    return {"data": data["data"], "layout": data["layout"]}


def whiskers(values: Sequence[float], lows: Sequence[float], highs: Sequence[float]) -> dict[str, Any]:
    """Return the error bars of intervals around values, no wider than the interval where the value lies outside."""
    return {
        "type": "data",
        "symmetric": False,
        "array": [max(high - value, 0.0) for value, high in zip(values, highs, strict=True)],
        "arrayminus": [max(value - low, 0.0) for value, low in zip(values, lows, strict=True)],
        "color": INK,
        "thickness": 1.3,
        "width": 4,
    }


def gaps(problem: str, lines: Sequence[LeaderboardRow]) -> Chart:
    """Return the gaps of all agents of a problem, with their intervals; who has none is named all the same."""
    paint, names = colours(line.agent for line in lines), [label(line.name) for line in lines]
    there = [line for line in lines if not isnan(line.gap)]
    figure = go.Figure()
    figure.add_scatter(
        x=[line.gap for line in there], y=[label(line.name) for line in there], mode="markers", showlegend=False,
        marker={"size": 10, "color": [paint[line.agent] for line in there]},
        error_x=whiskers([x.gap for x in there], [x.gap_low for x in there], [x.gap_high for x in there]),
        customdata=[[line.gap_low, line.gap_high] for line in there],
        hovertemplate="%{y}: %{x:.1%}, 95 % within %{customdata[0]:.1%} to %{customdata[1]:.1%}<extra></extra>",
    )  # fmt: skip
    for line in lines:
        if isnan(line.gap):
            figure.add_annotation(
                x=0, y=label(line.name), text=missing(line), showarrow=False,
                xanchor="left", xshift=8, font={"color": COLOURS[1]},
            )  # fmt: skip
    figure.add_vline(x=0, line={"color": INK, "width": 1.5})
    top = max([0.05, *(line.gap_high for line in there), *(line.gap for line in there)])
    figure.update_xaxes(title="gap to K*", tickformat=".0%", range=[-0.03 * top, 1.06 * top], zeroline=False)
    rows(figure, names)
    title = f"{problem}: gap to K*"
    caption = f"<b>{escape(problem)}</b>: how far above K*, interquartile mean with its 95 % bootstrap interval"
    return Chart(caption, title, drawn(figure), 80 + 28 * max(len(lines), 2))


def missing(line: LeaderboardRow) -> str:
    """Return why an agent has no gap."""
    if line.failed:
        return "failed"
    return "K* unknown" if line.success else "never at the goal"


def learning(problem: str, curves: Sequence[Curve]) -> Chart:
    """Return how near K* the trainings of a problem came after so many steps."""
    paint, figure, told = colours(curve.agent for curve in curves), go.Figure(), set()
    for curve in curves:
        if not curve.steps:
            continue
        figure.add_scatter(
            x=curve.steps, y=curve.gaps, mode="lines+markers", name=label(curve.name), legendgroup=curve.agent,
            showlegend=curve.agent not in told, marker={"size": 5},
            line={"color": paint[curve.agent], "width": 1.8, "shape": "hv"},
            hovertemplate=f"{label(curve.name)}, seed {curve.seed}: %{{y:.1%}} after %{{x:.3s}}<extra></extra>",
        )  # fmt: skip
        told.add(curve.agent)
    figure.add_hline(y=0, line={"color": INK, "width": 1.5, "dash": "dot"})
    figure.add_annotation(text="K*", x=1, xref="paper", y=0, yanchor="bottom", showarrow=False, font={"color": INK})
    figure.update_xaxes(title="environment steps, flown and shown", type="log", exponentformat="SI", dtick=1)
    most = max((gap for curve in curves for gap in curve.gaps), default=0.0)
    figure.update_yaxes(title="gap to K*", tickformat=".0%", range=[-0.015, max(0.05, min(0.6, 1.08 * most))])
    figure.update_layout(legend={"orientation": "h", "y": -0.28, "yanchor": "top", "x": 0})
    title = f"{problem}: gap while learning"
    caption = (
        f"<b>{escape(problem)}</b>: least gap so far of the checks that succeeded in {100 * RELIABLE:.0f} %, a line "
        "for each training; who has no line never did"
    )
    return Chart(caption, title, drawn(figure), 360)


def robustness(
    problem: str, standings: Sequence[ConditionScore], conditions: Mapping[str, Mapping[str, float]]
) -> Chart:
    """Return the success of all agents of a problem under each condition, with intervals."""
    figure, names = go.Figure(), list(dict.fromkeys(label(one.name) for one in standings))
    shades = [*COLOURS, FLAME, *MORE]
    for i, (condition, active) in enumerate(conditions.items()):
        some = [one for one in standings if one.condition == condition]
        figure.add_scatter(
            x=[one.success for one in some], y=[label(one.name) for one in some], mode="markers",
            name=escape(condition), orientation="h", offsetgroup=condition,
            marker={"size": 8, "symbol": SYMBOLS[i % len(SYMBOLS)], "color": shades[i % len(shades)]},
            error_x=whiskers([x.success for x in some], [x.success_low for x in some], [x.success_high for x in some])
            | {"width": 2, "thickness": 1, "color": shades[i % len(shades)]},
            hovertemplate=f"%{{y}}, {escape(strength(dict(active)) or condition)}: %{{x:.1%}}<extra></extra>",
        )  # fmt: skip
    figure.update_xaxes(title="success", tickformat=".0%", range=[-0.02, 1.03], tickvals=[0, 0.25, 0.5, 0.75, 1])
    rows(figure, names)
    figure.update_layout(
        scattermode="group", scattergap=0.25,
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0, "xref": "container"},
    )  # fmt: skip
    title = f"{problem}: success under disturbances"
    caption = f"<b>{escape(problem)}</b>: success under disturbances, with 95 % bootstrap intervals"
    return Chart(caption, title, drawn(figure), 120 + 13 * max(len(names), 2) * max(len(conditions), 2))


def rows(figure: go.Figure, names: Sequence[str]) -> None:
    """Make the vertical axis one of names, the first on top."""
    figure.update_yaxes(
        type="category", categoryorder="array", categoryarray=names, range=[len(names) - 0.4, -0.6],
        automargin=True, ticklabelstandoff=6,
    )  # fmt: skip


def of_problem(board: Leaderboard, problem: str, conditions: Mapping[str, Mapping[str, float]]) -> dict[str, Chart]:
    """Return the charts of a problem: "gap", then "learning" and "robustness" where there is something to show."""
    curves = [curve for curve in board.curves if curve.problem == problem]
    standings = [one for one in board.standings if one.problem == problem]
    charts = {"gap": gaps(problem, [line for line in board.lines if line.problem == problem])}
    if curves:
        charts["learning"] = learning(problem, curves)
    if standings and len(conditions) > 1:
        charts["robustness"] = robustness(problem, standings, conditions)
    return charts


def of_paper(judged: Sequence[Mapping[str, Any]]) -> dict[str, Chart]:
    """Return the paper's figures by name, and the verdict on its times where there is one.

    Args:
        judged: rows of `paper.judge`; may be empty.
    """
    charts = {}
    for name, draw in figures.pages(judged).items():
        if name == "judged" and not judged:
            continue
        figure = draw()
        title, size, kept = figure.layout.title.text, figure.layout.height, name == "judged"
        data = drawn(figure)
        if kept:  # its words stand in the margins
            data["layout"]["margin"] = figure.layout.margin.to_plotly_json()
        aspect = 0.0 if name in ("figure-6", "judged") else size / figures.WIDTH
        caption = escape(title).replace("&lt;sub&gt;", "<sub>").replace("&lt;/sub&gt;", "</sub>")
        words = title.replace("<sub>", "").replace("</sub>", "")
        height = 560 if name in SQUARE else size
        charts[name] = Chart(caption, words, data, height, aspect, figures.WIDTH - 240 if kept else 0)
    return charts
