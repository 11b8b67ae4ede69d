"""The paper's Figs. 2 to 6, drawn from flights that keep all limits at all times.

Fig. 2 explains the idea, y_r(s) = p_1(s) y_1(s) + p_2(s) y_2(s) between outer paths y_1 and y_2. Figs. 3, 4
and 5 show the vehicle in equal time steps, Fig. 6 the controls of the flight of Fig. 5. `verdict_figure` is ours: it
shows the printed times and our certified times relative to the proven lower bound.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

import optimal
from experiments import figures
from experiments.figures import COLOURS, FAINT, INK, OUTLINE, Track
from experiments.paper.verdicts import verdict_texts
from flatgym import SCENARIOS
from flatgym.quadrotor import Array
from optimal.flights.solution import Solution
from optimal.paths.corridors import paper_corridor
from optimal.paths.curves import BezierPath

WIDTH = 900
"""Width of every figure [px]."""
MARGIN = 1.7
"""Space for labels beside the times of the verdict figure [%]."""
MINUS = "\N{MINUS SIGN}"
UPPER = BezierPath(((0.0, 1.6), (1.2, 3.0), (2.3, 1.9), (3.7, 0.7), (4.6, 3.1), (6.0, 2.8)))
LOWER = BezierPath(((0.0, 0.7), (1.2, 0.6), (2.2, 1.4), (3.4, 0.7), (4.6, 0.1), (6.0, 1.6)))
"""The outer paths y_1 and y_2 of Fig. 2 [m]; the paper draws its own without numbers."""
WALLS = (
    ((-0.4, 3.5), (-0.4, 2.6), (1.8, 2.6), (2.6, 2.2), (3.4, 2.2), (4.2, 3.0), (6.4, 3.0), (6.4, 3.5)),
    ((-0.4, -0.1), (-0.4, 0.4), (1.2, 0.4), (2.0, 0.6), (2.8, 0.6), (3.6, 0.3), (6.4, 0.3), (6.4, -0.1)),
)
"""The constrained environment of Fig. 2: corners of the hatched areas [m]."""


@lru_cache(maxsize=8)
def solved(name: str, method: str) -> Solution:
    """Return the solution of a case by one of the methods; figures share it.

    Raises:
        SolveFailed: if the method finds no certified flight.
    """
    # The figures show the paper's own outer paths.
    return optimal.solve(name, method=method, corridor="fixed" if method == "flat" else None)


def track(name: str, method: str = "flat", words: str = "") -> Track:
    """Return the flight of a case by one of the methods, to draw; its label is `words` and the time."""
    solution = solved(name, method)
    return replace(figures.optimal_track(solution), name=f"{words}T = {solution.time:.4f} s")


def fig2() -> go.Figure:
    """Return two outer paths in a constrained environment and the path between them, p_1 = 1 - sqrt(s)."""
    s = np.linspace(0, 1, 401)
    share = np.sqrt(s)[:, None]
    upper, lower = UPPER(s), LOWER(s)
    middle = (1 - share) * upper + share * lower
    figure = go.Figure()
    for wall in WALLS:
        x, z = np.array([*wall, wall[0]]).T
        figure.add_scatter(
            x=x, y=z, mode="lines", fill="toself", hoverinfo="skip", name="wall",
            line={"color": INK, "width": 1.5},
            fillpattern={"shape": "/", "fgcolor": OUTLINE, "bgcolor": "white", "size": 9, "solidity": 0.15},
        )  # fmt: skip
    ribs = np.concatenate([np.array([upper[i], lower[i], [np.nan] * 2]) for i in range(0, 401, 40)])
    _line(figure, ribs, "equal s", {"color": OUTLINE, "width": 1, "dash": "dot"})
    for line, name, colour, width in (
        (upper, "y<sub>1</sub>(s)", COLOURS[0], 2.0),
        (lower, "y<sub>2</sub>(s)", COLOURS[2], 2.0),
        (middle, "y<sub>r</sub>(s)", COLOURS[1], 3.0),
    ):
        _line(figure, line, name, {"color": colour, "width": width, "simplify": False})
        at = 59  # amid two ribs
        figure.add_annotation(
            x=line[at, 0], y=line[at, 1], text=name, showarrow=False, yshift=14, font={"color": colour, "size": 15}
        )
    figure.add_scatter(
        x=middle[::40, 0], y=middle[::40, 1], mode="markers", hoverinfo="skip", name="equal s",
        marker={"size": 7, "color": COLOURS[1]},
    )  # fmt: skip
    figure.update_xaxes(title="x [m]", range=[-0.4, 6.4], constrain="domain", zeroline=False, dtick=1)
    figure.update_yaxes(title="z [m]", range=[-0.1, 3.5], scaleanchor="x", constrain="domain", zeroline=False, dtick=1)
    title = "Fig. 2: y<sub>r</sub> = (1 - √s) y<sub>1</sub> + √s y<sub>2</sub> stays between the outer paths"
    return _sized(figures.layout(figure, title).update_layout(showlegend=False), 580)


def fig3() -> go.Figure:
    """Return the horizontal manoeuvre over 6 m, without and with the ground."""
    cases = {"horizontal-6": "in free space, ", "ground-6": "above the ground, "}
    tracks = [track(name, words=words) for name, words in cases.items()]
    figure = figures.paths([SCENARIOS[name] for name in cases], tracks, "Fig. 3: horizontal manoeuvre, 6 m")
    return _sized(figure, 520)


def fig4() -> go.Figure:
    """Return the general manoeuvre to (5, 5) m."""
    figure = figures.paths(SCENARIOS["diagonal"], [track("diagonal")], "Fig. 4: general manoeuvre to (5, 5) m")
    return _sized(figure, 860)


def fig5() -> go.Figure:
    """Return the manoeuvre to (5, 5) m through the hoop, between the outer paths."""
    scenario, s = SCENARIOS["hoop"], np.linspace(0, 1, 401)
    figure = figures.paths(scenario, [track("hoop")], "Fig. 5: manoeuvre to (5, 5) m through a hoop of 0.5 m")
    upper, lower = (path(s) for path in paper_corridor(scenario).paths)
    between = np.concatenate([upper, lower[::-1]])
    figure.add_scatter(
        x=between[:, 0], y=between[:, 1], mode="none", fill="toself", fillcolor=FAINT, opacity=0.4,
        name="corridor", hoverinfo="skip",
    )  # fmt: skip
    figure.data = (figure.data[-1], *figure.data[:-1])  # below the flight
    for line, name, at, shift in ((upper, "y<sub>1</sub>", 115, 22), (lower, "y<sub>2</sub>", 285, -22)):
        _line(figure, line, "outer path", {"color": OUTLINE, "width": 1.5, "dash": "dash"})
        figure.add_annotation(
            x=line[at, 0], y=line[at, 1], text=name, showarrow=False, xshift=shift, font={"color": INK, "size": 15}
        )
    return _sized(figure, 860)


def fig6() -> go.Figure:
    """Return the controls of the manoeuvre through the hoop, by the paper's method and by shooting."""
    tracks = [track("hoop", method, f"{method}, ") for method in ("flat", "shooting")]
    return _sized(figures.controls(SCENARIOS["hoop"].quadrotor, tracks, "Fig. 6: controls through the hoop"), 560)


Draw = Callable[[], go.Figure]
FIGURES: dict[str, Draw] = {
    "figure-2": fig2,
    "figure-3": fig3,
    "figure-4": fig4,
    "figure-5": fig5,
    "figure-6": fig6,
}
"""The paper's figures by the names of their files."""


def verdict_figure(rows: Sequence[Mapping[str, Any]]) -> go.Figure:
    """Return printed and certified times in percent above the proven lower bound, below which no flight exists.

    Args:
        rows: of `paper.check_printed_time`.
    """
    table = pd.DataFrame(rows)
    texts, lines = verdict_texts(table), np.arange(len(table))
    bound = table["lower_bound_s"].to_numpy(dtype=float)
    printed, certified = (
        100 * (table[key].to_numpy(dtype=float) / bound - 1) for key in ("printed_s", "upper_bound_s")
    )
    top, bottom = -1.5, len(lines) - 0.4
    left, right = np.nanmin([0, *printed]) - MARGIN, np.nanmax([*printed, *certified]) + MARGIN
    figure = go.Figure()
    figure.add_vrect(x0=left, x1=0, fillcolor=COLOURS[1], opacity=0.1, layer="below", line_width=0)
    _line(figure, np.array([[0, top], [0, bottom]]), "bound", {"color": INK, "width": 2})
    for x, y in zip(printed, lines, strict=True):
        _line(figure, np.array([[x, y], [0, y]]), "shortfall", {"color": COLOURS[1], "width": 3})
    for name, percent, colour, side, shift in (
        ("printed", printed, COLOURS[1], "right", -9),
        ("T* upper bound", certified, COLOURS[0], "left", 9),
    ):
        figure.add_scatter(
            x=percent, y=lines, mode="markers", name=name, text=texts[name] + " s", hoverinfo="name+text",
            marker={"size": 10, "color": colour},
        )  # fmt: skip
        for i in lines[np.isfinite(percent)]:  # NaN where no time is printed
            text = f"{percent[i]:+.2f} %".replace("-", MINUS)
            _note(figure, text, colour, x=percent[i], y=i, xanchor=side, xshift=shift)
    _note(figure, "impossible: faster than any flight", COLOURS[1], x=0, y=-1, xanchor="right", xshift=-9)
    _columns(figure, texts)
    figure.update_xaxes(title="flight time above the proven lower bound [%]", range=[left, right], zeroline=False)
    figure.update_yaxes(range=[bottom, top], showticklabels=False, showgrid=False, zeroline=False)
    figures.layout(figure, "The paper's times against the proven lower bound")
    figure.update_layout(showlegend=False, margin={"l": 235, "r": 172, "t": 65})
    return _sized(figure, 153 + 38 * len(lines))


def _columns(figure: go.Figure, texts: pd.DataFrame) -> None:
    """Write cases and times beside the lines of `verdict_figure`."""
    for column, heading, colour, edge, side, shift in (
        ("case", "case", INK, 0, "left", -190),
        ("printed", "printed [s]", COLOURS[1], 0, "right", -14),
        ("lower bound", "bound [s]", INK, 1, "right", 74),
        ("T* upper bound", "T* [s]", COLOURS[0], 1, "right", 150),
    ):
        for y, text in enumerate([heading, *texts[column]], start=-1):
            _note(figure, text, colour, x=edge, xref="paper", y=y, xanchor=side, xshift=shift)


def pages(rows: Sequence[Mapping[str, Any]]) -> dict[str, Draw]:
    """Return all figures by the names of their files; `rows` are those of `paper.check_printed_time`."""
    return {**FIGURES, "verdicts": partial(verdict_figure, rows)}


def write_pages(pages: Mapping[str, Draw], folder: Path, progress: Callable[[], Any] = lambda: None) -> None:
    """Write figures as pages into a folder; `progress` is called after each."""
    for name, draw in pages.items():
        figures.write_page(draw(), folder / f"{name}.html")
        progress()


def _line(figure: go.Figure, points: Array, name: str, style: dict[str, Any]) -> None:
    figure.add_scatter(x=points[:, 0], y=points[:, 1], mode="lines", name=name, line=style, hoverinfo="skip")


def _note(figure: go.Figure, text: str, colour: str, **place: Any) -> None:
    figure.add_annotation(text=text, font={"color": colour}, showarrow=False, **place)


def _sized(figure: go.Figure, height: int) -> go.Figure:
    return figure.update_layout(width=WIDTH, height=height)
