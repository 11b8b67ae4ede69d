"""The figure of the agents in `learners.json`: success, gap, and learning curves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from experiments.benchmark.agents import colour, display_name
from experiments.benchmark.conditions import COMBINED, NOMINAL
from experiments.benchmark.summary import cells_of, learning_curve, pairs, summarise
from experiments.figures import INK, layout
from experiments.files import Row
from flatgym.files import write_text

PICTURE = "learners.svg"


def picture(results: Row) -> go.Figure:
    """Return success and gap of all agents, and the gap of the learners over their samples."""
    found = summarise(results)
    problems = sorted(results["k_star"])
    titles = [f"{name}: {what}" for name in problems for what in ("success", "gap to K*", "gap during training")]
    figure = make_subplots(
        rows=len(problems), cols=3, subplot_titles=titles, horizontal_spacing=0.06, vertical_spacing=0.16,
        column_widths=[0.27, 0.27, 0.46],
    )  # fmt: skip
    for row, problem in enumerate(problems, start=1):
        agents = [agent for name, agent in pairs(found) if name == problem]
        success_bars(figure, [found[problem, agent, NOMINAL] for agent in agents], row)
        disturbed_marks(figure, [found[problem, agent, COMBINED] for agent in agents], row)
        gap_marks(figure, [found[problem, agent, NOMINAL] for agent in agents], row)
        for agent in agents:
            for number, cell in enumerate(cells_of(results, problem, agent)):
                gap_curve(figure, cell, results["validation_k_star"][problem], row, legend=row == 1 and number == 0)
        for column in (1, 2):
            figure.update_yaxes(
                categoryorder="array", categoryarray=[display_name(agent) for agent in reversed(agents)],
                showticklabels=column == 1, ticklabelstandoff=8, dtick=1, row=row, col=column,
            )  # fmt: skip
        figure.update_xaxes(range=[0, 1.04], tickformat=".0%", tickvals=[0, 0.5, 1], row=row, col=1)
        figure.update_xaxes(tickformat=".0%", rangemode="tozero", row=row, col=2)
        figure.update_yaxes(tickformat=".0%", range=[-0.01, 0.4], side="right", row=row, col=3)
        figure.update_xaxes(type="log", exponentformat="SI", dtick=1, row=row, col=3)
    for column, text in enumerate(("diamonds: disturbed", "nominal", "samples: env steps and expert labels"), start=1):
        figure.update_xaxes(title={"text": text, "font": {"size": 13}}, row=len(problems), col=column)
    figure.update_traces(cliponaxis=False, col=1)
    figure.update_traces(cliponaxis=False, col=2)
    figure.update_annotations(font_size=13)
    return layout(figure, "Success and gap to the optimum").update_layout(
        width=1100,
        height=160 + 260 * len(problems),
        bargap=0.35,
        margin={"l": 160, "r": 50, "t": 110, "b": 50},
        legend={"y": 1 + 30 / (260 * len(problems))},
    )


def error_bars(rows: Sequence[Row], name: str, middle: str) -> dict[str, Any]:
    """Return error bars for an interval."""
    return {
        "type": "data",
        "symmetric": False,
        "array": [row[f"{name}_high"] - row[middle] for row in rows],
        "arrayminus": [row[middle] - row[f"{name}_low"] for row in rows],
        "color": INK,
        "thickness": 1.2,
        "width": 3,
    }


def success_bars(figure: go.Figure, rows: Sequence[Row], row: int) -> None:
    """Draw the success of nominal episodes."""
    figure.add_bar(
        x=[one["success_rate"] for one in rows], y=[display_name(one["agent"]) for one in rows], orientation="h",
        marker={"color": [colour(one["agent"]) for one in rows]}, error_x=error_bars(rows, "success", "success_rate"),
        showlegend=False, row=row, col=1,
    )  # fmt: skip


def disturbed_marks(figure: go.Figure, rows: Sequence[Row], row: int) -> None:
    """Draw the success of disturbed episodes."""
    figure.add_scatter(
        x=[one["success_rate"] for one in rows], y=[display_name(one["agent"]) for one in rows], mode="markers",
        marker={"symbol": "diamond", "size": 9, "color": "white", "line": {"color": INK, "width": 1.5}},
        error_x=error_bars(rows, "success", "success_rate"), showlegend=False, row=row, col=1,
    )  # fmt: skip


def gap_marks(figure: go.Figure, rows: Sequence[Row], row: int) -> None:
    """Draw the gaps with their intervals."""
    figure.add_scatter(
        x=[one["gap"] for one in rows], y=[display_name(one["agent"]) for one in rows], mode="markers",
        marker={"size": 9, "color": [colour(one["agent"]) for one in rows]}, error_x=error_bars(rows, "gap", "gap"),
        showlegend=False, row=row, col=2,
    )  # fmt: skip


def gap_curve(figure: go.Figure, cell: Row, validation_k_star: float, row: int, legend: bool) -> None:
    """Draw the smallest gap so far of the validations that reach the target success."""
    if not cell["curve"]:
        return
    samples, least = learning_curve(cell, validation_k_star)
    figure.add_scatter(
        x=samples, y=least,
        mode="lines+markers", line={"color": colour(cell["agent"]), "width": 1.5, "shape": "hv"}, marker={"size": 5},
        name=display_name(cell["agent"]), legendgroup=cell["agent"], showlegend=legend, row=row, col=3,
    )  # fmt: skip


def draw(folder: Path, results: Row) -> None:
    """Draw the figure as SVG; needs the extra `figures` and a Chromium."""
    write_text(folder / PICTURE, picture(results).to_image("svg").decode())
