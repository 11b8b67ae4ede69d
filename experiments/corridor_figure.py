"""The figure of corridors that converge: outer paths and flights of each step, and the times, which only fall."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from experiments.figures import COLOURS, INK, OUTLINE, add_scenery, layout
from experiments.files import Row
from flatgym import SCENARIOS
from flatgym.files import write_text
from flatgym.quadrotor import Array

SECTION, FILE = "flat_convergence", "corridors.svg"
"""The section of `solvers.json`, and the name of the figure."""
AROUND = np.array([0.5, 0.6])
"""Room around the lines [m]."""
FIRST, LAST = "#d1603d", "#0b6e99"
"""Colours of the first and of the last corridor."""


def corridors_figure(rows: Sequence[Row]) -> go.Figure:
    """Return corridors and flights of each scenario, and the time of each flight beside them."""
    figure = make_subplots(
        rows=len(rows), cols=2, column_widths=[0.72, 0.28], horizontal_spacing=0.09, vertical_spacing=0.16,
        subplot_titles=[title for row in rows for title in (row["scenario"], "flight time")],
    )  # fmt: skip
    for i, row in enumerate(rows, start=1):
        draw_paths(figure, row, {"row": i, "col": 1}, legend=i == 1)
        draw_times(figure, row, {"row": i, "col": 2})
    for name in ("hoop", "start", "goal"):
        figure.update_traces(showlegend=False, selector={"name": name})
    return layout(figure, "Corridors follow the flight to the optimum").update_layout(
        width=1000,
        height=120 + 340 * len(rows),
        margin={"b": 90},
        legend={"orientation": "h", "y": -0.1, "yanchor": "top", "x": 0.0, "xanchor": "left"},
    )


def draw_paths(figure: go.Figure, row: Row, panel: dict[str, int], *, legend: bool) -> None:
    """Draw the start, the corridors and the last flight of a scenario."""
    flights, corridors = [np.array(each) for each in row["flights_m"]], row["outer_paths_m"]
    shown = {"mode": "lines", "hoverinfo": "skip"} | panel
    for outer, colour, name in ((corridors[0], FIRST, "first corridor"), (corridors[-1], LAST, "last corridor")):
        first, second = (np.array(path) for path in outer)
        band = np.concatenate([first, second[::-1], first[:1]])
        figure.add_scatter(
            x=band[:, 0], y=band[:, 1], name=name, showlegend=legend, fill="toself", opacity=0.35,
            line={"color": colour, "width": 1}, fillcolor=colour, **shown,
        )  # fmt: skip
    for flight, name, colour, dash in (
        (flights[0], "the flight it starts from", OUTLINE, "dash"), (flights[-1], "the last flight", INK, "solid")
    ):  # fmt: skip
        line = {"color": colour, "width": 2, "dash": dash}
        figure.add_scatter(x=flight[:, 0], y=flight[:, 1], name=name, showlegend=legend, line=line, **shown)
    low, high = extent([*flights, *(np.array(path) for outer in corridors for path in outer)])
    add_scenery(figure, SCENARIOS[row["scenario"]], low, high, panel)
    common: dict[str, Any] = {"zeroline": False, "constrain": "domain", "dtick": 1}
    figure.update_yaxes(title="z [m]", scaleanchor=axis(figure, panel), range=[low[1], high[1]], **common, **panel)
    figure.update_xaxes(title="x [m]", range=[low[0], high[0]], **common, **panel)


def draw_times(figure: go.Figure, row: Row, panel: dict[str, int]) -> None:
    """Draw the time of the start and of the flight in each corridor, above the best-known time."""
    steps = np.arange(len(row["times_s"]))
    figure.add_scatter(
        x=steps[[0, -1]], y=[row["best_s"]] * 2, mode="lines", showlegend=False, hoverinfo="skip",
        line={"color": COLOURS[2], "width": 2, "dash": "dot"}, **panel,
    )  # fmt: skip
    figure.add_scatter(
        x=steps, y=row["times_s"], mode="lines+markers", showlegend=False, line={"color": INK, "width": 2},
        marker={"size": 8}, **panel,
    )  # fmt: skip
    texts = ["start", *map(str, steps[1:])]
    figure.update_xaxes(title="corridor", tickvals=steps, ticktext=texts, zeroline=False, **panel)
    figure.update_yaxes(title="T [s]; dotted: T*", zeroline=False, **panel)


def axis(figure: go.Figure, panel: dict[str, int]) -> str:
    """Return the name of the horizontal axis of a panel."""
    return str(next(figure.select_xaxes(**panel)).plotly_name).replace("axis", "")


def extent(lines: Sequence[Array]) -> tuple[Array, Array]:
    """Return the least and greatest coordinates of lines, with room around them, shape (2,) each."""
    points = np.concatenate(lines)
    return points.min(axis=0) - AROUND, points.max(axis=0) + AROUND


def draw(folder: Path, results: dict[str, Any]) -> None:
    """Draw the figure as SVG, if its section is measured."""
    if SECTION in results["sections"]:
        figure = corridors_figure(results["sections"][SECTION]["rows"])
        write_text(folder / FILE, figure.to_image("svg").decode())
