"""The figure of the full benchmark (`benchmark-full.json`): gaps against work, and performance profiles over tasks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from agents.evaluation.bootstrap import LEVEL, bootstrap_positions
from experiments.benchmark.agents import NAMES, colour, display_name
from experiments.benchmark.conditions import NOMINAL
from experiments.benchmark.summary import episode_table
from experiments.benchmark.work import gap_within, spent
from experiments.figures import decades, layout
from experiments.files import Row
from experiments.recipes.registry import LEARNERS
from flatgym.files import write_text
from flatgym.quadrotor import Array

PICTURE = "profiles.svg"
LEAST_TASKS = 10
"""Tasks that an agent must have flown to be in the figure."""
GAPS = np.geomspace(2e-3, 1.0, 80)
"""Gaps at which performance profiles are evaluated."""
PLANNED = ("expert", "expert-no-margin", "mpc", "open-loop")
"""Agents that follow an optimal flight; their profiles would cover those of the learners."""
LEAST_WORK = {"samples": 1e3, "seconds": 1.0}
"""Samples and training time [s] at which learning curves begin."""
DASHES = {"pd": "dash", "hover": "dot", "random": "dashdot"}
"""Dashes of agents that share a colour."""
RESAMPLES = 200


def picture(results: Row) -> go.Figure:
    """Return the median gap of the learners by samples and by training time, and profiles.

    Gaps below the lowest of GAPS, K* among them, are drawn as that one.
    """
    flown = {(cell["problem"], cell["agent"]) for cell in results["cells"] if cell["episodes"]}
    names = [name for name in NAMES if name not in PLANNED]
    agents = [name for name in names if sum(agent == name for _, agent in flown) >= LEAST_TASKS]
    figure = make_subplots(rows=1, cols=3, horizontal_spacing=0.07)
    for agent in agents:
        cells = [cell for cell in results["cells"] if cell["agent"] == agent and cell["episodes"]]
        if agent in LEARNERS:
            for column, (work, least) in enumerate(LEAST_WORK.items(), start=1):
                limits = np.geomspace(least, max(spent(cell["curve"][-1], work) for cell in cells), 80)
                bands = gaps_by_limit(cells, results["validation_k_star"], work, limits)
                middle, low, high = (np.maximum(gaps, GAPS[0]) for gaps in bands)
                add_band(figure, agent, limits, middle, low, high, column, legend=False)
        add_band(figure, agent, GAPS, *profile({**results, "cells": cells}), column=3, legend=True)
    percents = decades(percent=True) | {"range": [np.log10(GAPS[0]) - 0.02, 0]}
    figure.update_yaxes(title="gap to K*, median of trainings", **percents, row=1, col=1)
    figure.update_yaxes(**percents, row=1, col=2)
    figure.update_xaxes(title="samples", type="log", exponentformat="SI", dtick=1, row=1, col=1)
    figure.update_xaxes(title="training time [s]", type="log", dtick=1, row=1, col=2)
    figure.update_xaxes(title="gap to K*", **percents, tickangle=0, tickfont_size=10, row=1, col=3)
    figure.update_yaxes(title="episodes within the gap", tickformat=".0%", range=[-0.01, 1.02], row=1, col=3)
    return layout(figure, "Gap against work, and performance profiles").update_layout(
        width=1150,
        height=430,
        margin={"l": 70, "r": 20, "t": 95, "b": 55},
        legend={"y": 1.05, "x": 0.0, "xanchor": "left"},
        title={"y": 0.96},
    )


def gaps_by_limit(
    cells: Sequence[Row], k_star: dict[str, float], work: str, limits: Array
) -> tuple[Array, Array, Array]:
    """Return the median over trainings of the smallest gap within each limit of work, and the quartiles.

    A training without a validation of the target success within the limit counts as infinite.
    """
    gaps = [[gap_within(cell, k_star[cell["problem"]], work, limit) for limit in limits] for cell in cells]
    low, middle, high = np.quantile(gaps, [0.25, 0.5, 0.75], axis=0, method="higher")
    return middle, low, high


def profile(results: Row) -> tuple[Array, Array, Array]:
    """Return the share of nominal episodes with a gap of at most GAPS, the mean over tasks, and its interval.

    A performance profile, with the stratified bootstrap of `agents.evaluation.bootstrap` (Agarwal et al. 2021).
    """
    rows = episode_table(results)
    rows = rows[rows["condition"] == NOMINAL].reset_index(drop=True)
    gap = rows["gap"].where(rows["outcome"] == "goal", np.inf).to_numpy()
    shares, resampled = [], []
    for _, task in rows.groupby("scenario", sort=False):
        own = gap[task.index]
        places = bootstrap_positions(task.reset_index(drop=True), resamples=RESAMPLES)
        drawn = np.where(places >= 0, own[places], np.nan)
        counts = (places >= 0).sum(axis=1)
        shares.append([(own <= limit).mean() for limit in GAPS])
        resampled.append([(drawn <= limit).sum(axis=1) / counts for limit in GAPS])
    low, high = np.quantile(np.mean(resampled, axis=0), [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=1)
    return np.mean(shares, axis=0), low, high


def add_band(
    figure: go.Figure, agent: str, x: Array, middle: Array, low: Array, high: Array, column: int, legend: bool
) -> None:
    """Draw a line of an agent and the band between two others; what is infinite is left out."""
    finite = np.isfinite(high)
    shade = "rgba({}, {}, {}, 0.18)".format(*(int(colour(agent)[i : i + 2], 16) for i in (1, 3, 5)))
    figure.add_scatter(
        x=np.concatenate([x[finite], x[finite][::-1]]), y=np.concatenate([high[finite], low[finite][::-1]]),
        fill="toself", fillcolor=shade, line={"width": 0}, mode="lines", showlegend=False, hoverinfo="skip",
        row=1, col=column,
    )  # fmt: skip
    finite = np.isfinite(middle)
    figure.add_scatter(
        x=x[finite], y=middle[finite], mode="lines", name=display_name(agent), showlegend=legend,
        line={"color": colour(agent), "width": 2, "dash": DASHES.get(agent)}, row=1, col=column,
    )  # fmt: skip


def draw(folder: Path, results: Row) -> None:
    """Draw the figure as SVG; needs the extra `figures` and a Chromium."""
    write_text(folder / PICTURE, picture(results).to_image("svg").decode())
