"""Charts of the paper's figures, of the verdict on its times, and of corridors that follow the flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from experiments.corridor_figure import corridors_figure
from experiments.paper import figures
from experiments.report.chart_style import plain_figure
from experiments.report.charts import Chart

SQUARE = ("figure-4", "figure-5")
"""Maps as high as wide."""
FIXED_HEIGHT = ("figure-6", "verdicts")
"""Plots over time, and of verdicts, whose height does not follow the width."""


def paper_charts(verdicts: Sequence[Mapping[str, Any]], corridors: Sequence[dict[str, Any]] = ()) -> dict[str, Chart]:
    """Return the charts by name: the paper's figures, and "verdicts" and "corridors" where there are any.

    Args:
        verdicts: the verdict rows of `paper.json`; may be empty.
        corridors: the rows of the section `flat_convergence` of `solvers.json`; may be empty.
    """
    charts = {}
    for name, draw in figures.pages(verdicts).items():
        if name == "verdicts" and not verdicts:
            continue
        figure = draw()
        title, height, with_margin = figure.layout.title.text, figure.layout.height, name == "verdicts"
        content = plain_figure(figure)
        if with_margin:  # it has labels in the margin
            content["layout"]["margin"] = figure.layout.margin.to_plotly_json()
        charts[name] = Chart(
            caption=escape(title).replace("&lt;sub&gt;", "<sub>").replace("&lt;/sub&gt;", "</sub>"),
            description=title.replace("<sub>", "").replace("</sub>", ""),
            figure=content,
            height=560 if name in SQUARE else height,
            aspect=0.0 if name in FIXED_HEIGHT else height / figures.WIDTH,
            min_width=figures.WIDTH - 240 if with_margin else 0,
        )
    if corridors:
        figure = corridors_figure(corridors)
        names = " and ".join(row["scenario"] for row in corridors)
        caption = f"{names}: corridors follow the flight of a weak vehicle to the optimum"
        charts["corridors"] = Chart(caption, caption, plain_figure(figure), figure.layout.height, min_width=640)
    return charts
