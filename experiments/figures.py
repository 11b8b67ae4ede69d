"""Plots a person would want to look at: paths with the vehicle drawn on them, controls, learning.

Paths show the quadrotor in equal time steps, as the paper's Figs. 3-5; controls are drawn as in
its Fig. 6; a learning curve is drawn against K*, the line no agent can cross.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from experiments.files import write_text
from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenario import Scenario

COLOURS = ("#0b6e99", "#d1603d", "#4f772d", "#7a4988")
INK, FAINT = "#22303c", "#c9d1d8"
ARM = 0.16
"""Half the width of the drawn quadrotor [m]."""


@dataclass(frozen=True)
class Track:
    """A flight to draw: its name, times (n,), states (n, 5) and the controls held after each time (n, 2)."""

    name: str
    time: Array
    state: Array
    control: Array


def layout(figure: go.Figure, title: str) -> go.Figure:
    """Return the figure in the house style."""
    figure.update_layout(
        title={"text": title, "font": {"size": 17}},
        template="plotly_white",
        font={"family": "system-ui, sans-serif", "size": 13, "color": INK},
        margin={"l": 55, "r": 20, "t": 60, "b": 50},
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 1.0, "xanchor": "right"},
        hoverlabel={"font": {"family": "system-ui, sans-serif"}},
    )
    return figure


def vehicle(state: Array) -> tuple[Array, Array]:
    """Return the outline of the quadrotor as two broken lines: arm with rotors, and thrust axis, each (n, 2).

    Coordinates are [m]; a NaN row lifts the pen.
    """
    along = np.array([np.cos(state[4]), -np.sin(state[4])])
    up = np.array([np.sin(state[4]), np.cos(state[4])])
    gap = np.full(2, np.nan)
    left, right = state[0:2] - ARM * along, state[0:2] + ARM * along
    rotors = [left, right, gap]
    for end in (left, right):
        tip = end + 0.35 * ARM * up
        rotors += [end, tip, gap, tip - 0.45 * ARM * along, tip + 0.45 * ARM * along, gap]
    return np.array(rotors), np.array([state[0:2], state[0:2] + 1.1 * ARM * up, gap])


def paths(scenario: Scenario, tracks: Sequence[Track], title: str, vehicles: int = 14) -> go.Figure:
    """Return the paths of flights through a scenario, `vehicles` quadrotors drawn on each in equal time steps."""
    figure = go.Figure()
    _scenery(figure, scenario, np.concatenate([track.state[:, 0:2] for track in tracks]))
    for track, colour in zip(tracks, COLOURS, strict=False):
        group = {"legendgroup": track.name, "line": {"color": colour}}
        x, z = track.state[:, 0], track.state[:, 1]
        times = [f"{t:.3f} s" for t in track.time]
        group["line"] = {"color": colour, "width": 1.6, "dash": "solid" if colour == COLOURS[0] else "dash"}
        figure.add_scatter(x=x, y=z, mode="lines", name=track.name, text=times, **group)
        instants = np.linspace(0.0, track.time[-1], vehicles)
        drawn = np.stack([np.interp(instants, track.time, track.state[:, i]) for i in range(5)], axis=-1)
        outline = np.concatenate([part for state in drawn for part in vehicle(state)])
        group["line"] = {"color": colour, "width": 2.2}
        figure.add_scatter(x=outline[:, 0], y=outline[:, 1], mode="lines", hoverinfo="skip", showlegend=False, **group)
    figure.update_yaxes(scaleanchor="x", scaleratio=1, title="z [m]", zeroline=False)
    figure.update_xaxes(title="x [m]", zeroline=False, constrain="domain")
    return layout(figure, title)


def _scenery(figure: go.Figure, scenario: Scenario, points: Array) -> None:
    """Draw start, goal, hoops with their direction, floor and ceiling."""
    low, high = points.min(axis=0) - 0.5, points.max(axis=0) + 0.5
    for height, fill_to in ((scenario.floor, low[1]), (scenario.ceiling, high[1])):
        if height is not None:
            figure.add_hrect(
                y0=min(height, fill_to), y1=max(height, fill_to), fillcolor=FAINT, opacity=0.5, line_width=0
            )
            figure.add_hline(y=height, line={"color": INK, "width": 1.5})
    for hoop in scenario.hoops:
        for side in (-1, 1):
            edge = hoop.centre + side * hoop.diameter / 2 * hoop.across
            post = edge + side * 0.45 * hoop.across
            figure.add_scatter(
                x=[edge[0], post[0]],
                y=[edge[1], post[1]],
                mode="lines",
                line={"color": INK, "width": 5},
                hoverinfo="skip",
                showlegend=False,
            )
    ends = np.array([scenario.start, scenario.goal])
    figure.add_scatter(
        x=ends[:, 0],
        y=ends[:, 1],
        mode="markers+text",
        text=["start", "goal"],
        textposition="bottom center",
        marker={"size": 9, "color": INK, "symbol": ["circle", "star"]},
        showlegend=False,
        hoverinfo="skip",
    )


def controls(quadrotor: Quadrotor, tracks: Sequence[Track], title: str) -> go.Figure:
    """Return thrust and rate over time with their limits, as the paper's Fig. 6."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.08)
    limits = np.stack([quadrotor.control_low, quadrotor.control_high])
    for row, label in enumerate(("thrust [m/s²]", "rate [rad/s]"), start=1):
        for limit in limits[:, row - 1]:
            figure.add_hline(y=limit, line={"color": INK, "width": 1, "dash": "dot"}, row=row, col=1)
        for track, colour in zip(tracks, COLOURS, strict=False):
            figure.add_scatter(
                x=track.time,
                y=track.control[:, row - 1],
                mode="lines",
                name=track.name,
                legendgroup=track.name,
                showlegend=row == 1,
                line={"color": colour, "width": 1.8, "shape": "hv"},
                row=row,
                col=1,
            )
        figure.update_yaxes(title=label, zeroline=False, row=row, col=1)
    figure.update_xaxes(title="time [s]", zeroline=False, row=2, col=1)
    return layout(figure, title)


def learning(curve: Sequence[Mapping[str, Any]], k_star: float, title: str) -> go.Figure:
    """Return the steps of the deterministic flight over training, against K*.

    Flights that did not reach the goal stand as crosses at the length of the longest that did.
    """
    env_steps = np.array([point["env_steps"] for point in curve], dtype=float)
    success = np.array([point["outcome"] == "goal" for point in curve])
    steps = np.array([point["steps"] for point in curve], dtype=float)
    top = max(steps[success].max(initial=k_star), 1.5 * k_star)
    figure = go.Figure()
    figure.add_scatter(
        x=env_steps[~success],
        y=np.full((~success).sum(), top),
        mode="markers",
        name="goal not reached",
        marker={"symbol": "x-thin", "size": 7, "line": {"color": COLOURS[1], "width": 1.5}},
    )
    figure.add_scatter(
        x=env_steps[success],
        y=steps[success],
        mode="lines+markers",
        name="deterministic flight",
        line={"color": COLOURS[0], "width": 1.8},
        marker={"size": 5},
    )
    figure.add_hline(
        y=k_star,
        line={"color": INK, "width": 1.5, "dash": "dot"},
        annotation={"text": f"K* = {k_star:.0f} steps", "font": {"color": INK}},
        annotation_position="bottom left",
    )
    figure.update_yaxes(title="environment steps to the goal", rangemode="normal", zeroline=False)
    figure.update_xaxes(title="environment steps of training", zeroline=False)
    return layout(figure, title)


def write(figure: go.Figure, path: Path | str) -> None:
    """Write a figure as a page of its own; plotly.min.js is put beside it once."""
    path = Path(path)
    script = path.with_name("plotly.min.js")
    if not script.exists():
        from plotly.offline import get_plotlyjs

        write_text(script, get_plotlyjs())
    write_text(path, figure.to_html(include_plotlyjs=script.name, full_html=True))
