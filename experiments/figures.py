"""Figures of flights and of training: paths with the vehicle on them, controls, learning curves.

Paths show the quadrotor in equal time steps, as the paper's Figs. 3-5. Controls are drawn as in its Fig. 6. A learning
curve is drawn against K*, its lower limit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from experiments.files import check_output
from experiments.formats import lower_bound
from flatgym import OUTCOMES
from flatgym.files import write_text
from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenarios.scenario import Hoop, Scenario
from flatgym.task.rollout import fly_actions
from optimal import Solution, Status

COLOURS = ("#0b6e99", "#d1603d", "#4f772d", "#7a4988")
FURTHER_COLOURS = ("#6aa9c4", "#a13d2d", "#e08f78", "#8f7a5a", "#86a86a", "#a886b3", "#2f8f83", "#b0698f")
"""Colours of variants of an agent, and of agents that few figures show."""
INK, OUTLINE, FAINT, FLAME = "#22303c", "#8b98a3", "#dfe4e8", "#e8a33d"
ARM = 0.18
"""Half the width of the drawn quadrotor [m]."""
POST, MARGIN = 0.45, 0.6
"""Length of the drawn posts of a hoop, and room around flights and hoops [m]."""
FINE = 0.002
"""Time between the drawn points of a flight [s]."""
THRUST_LENGTH = 0.02
"""Length of the drawn thrust per unit of thrust [m / (m/s^2)]."""


@dataclass(frozen=True)
class Track:
    """A flight to draw: its name, times (n,) [s], states (n, 5), and the controls held from each time on (n, 2)."""

    name: str
    time: Array
    state: Array
    control: Array


def optimal_track(solution: Solution) -> Track:
    """Return the certified flight of a solution as a track, sampled every FINE seconds.

    Its name says how far the flight is optimal. Only the time of a proven optimum is called T*.
    """
    assert solution.trajectory is not None
    samples = solution.trajectory.sample(FINE)
    name = (
        f"{solution.optimality}, T = {solution.time:.4f} s, T* ≥ {lower_bound(solution.certificate.lower_bound, 4)} s"
    )
    if solution.status is Status.OPTIMAL:
        name = f"optimum, T* = {solution.time:.4f} s"
    return Track(name, samples.time, samples.state, samples.control)


def replayed_track(scenario: Scenario, actions: NDArray[np.float32], name: str) -> Track:
    """Return the flight of actions (K, 2), replayed in the task, as a track."""
    situations = fly_actions(scenario, actions)
    states = np.array([situation.state[0] for situation in situations])
    controls = scenario.quadrotor.control(np.append(actions, actions[-1:], axis=0))
    time = np.linspace(0.0, scenario.dt * (len(states) - 1), len(states))
    label = f"{name}, {len(states) - 1} steps: {OUTCOMES[situations[-1].outcome[0]]}"
    return Track(label, time, states, controls[: len(states)])


def layout(figure: go.Figure, title: str) -> go.Figure:
    """Return the figure with the common title, fonts and margins."""
    figure.update_layout(
        title={"text": title, "font": {"size": 17}},
        template="plotly_white",
        font={"family": "system-ui, sans-serif", "size": 13, "color": INK},
        margin={"l": 55, "r": 20, "t": 80, "b": 50},
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 1.0, "xanchor": "right"},
        hoverlabel={"font": {"family": "system-ui, sans-serif"}},
    )
    return figure


def decades(*, percent: bool = False) -> dict[str, Any]:
    """Return a logarithmic axis with a tick at 1, 2 and 5 of each decade."""
    ticks = [digit * 10.0**power for power in range(-5, 5) for digit in (1, 2, 5)]
    texts = [f"{100 * tick:.6g} %" if percent else f"{tick:g}" for tick in ticks]
    return {"type": "log", "tickvals": ticks, "ticktext": texts, "zeroline": False}


def vehicle(state: Array) -> Array:
    """Return the outline of the quadrotor, an arm with two rotors, as points of a line, shape (n, 2) [m].

    A row of NaN interrupts the line.
    """
    along = np.array([np.cos(state[4]), -np.sin(state[4])])
    up = np.array([np.sin(state[4]), np.cos(state[4])])
    gap = np.full(2, np.nan)
    left, right = state[0:2] - ARM * along, state[0:2] + ARM * along
    outline = [left, right, gap]
    for end in (left, right):
        tip = end + 0.3 * ARM * up
        outline += [end, tip, gap, tip - 0.5 * ARM * along, tip + 0.5 * ARM * along, gap]
    return np.array(outline)


def thrust_line(state: Array, thrust: float) -> Array:
    """Return a line in the direction of the thrust, of a length proportional to it, shape (3, 2) [m]."""
    up = np.array([np.sin(state[4]), np.cos(state[4])])
    return np.array([state[0:2], state[0:2] + THRUST_LENGTH * thrust * up, np.full(2, np.nan)])


def paths(
    scenario: Scenario | Sequence[Scenario], tracks: Sequence[Track], title: str, vehicles: int = 14
) -> go.Figure:
    """Return the paths of flights through one scenario, or each through its own, with the vehicle on them.

    Each flight has its own panel with `vehicles` quadrotors in equal time steps. Tall panels are side by side, wide
    ones are stacked.
    """
    scenarios = [scenario] * len(tracks) if isinstance(scenario, Scenario) else scenario
    low, high = extent(scenarios, tracks)
    wide = high[0] - low[0] > 2 * (high[1] - low[1])
    rows, columns = (len(tracks), 1) if wide else (1, len(tracks))
    figure = make_subplots(
        rows=rows,
        cols=columns,
        shared_xaxes=True,
        shared_yaxes=True,
        subplot_titles=[track.name for track in tracks],
        horizontal_spacing=0.05,
        vertical_spacing=0.14,
    )
    for i, (track, world, colour) in enumerate(zip(tracks, scenarios, COLOURS, strict=False)):
        panel = {"row": i + 1, "col": 1} if wide else {"row": 1, "col": i + 1}
        add_flight(figure, track, colour, vehicles, panel)
        add_scenery(figure, world, low, high, panel)
        x_axis = next(figure.select_yaxes(**panel)).anchor
        figure.update_yaxes(
            range=[low[1], high[1]], scaleanchor=x_axis, scaleratio=1, zeroline=False, constrain="domain", **panel
        )
        figure.update_xaxes(range=[low[0], high[0]], zeroline=False, constrain="domain", dtick=1, **panel)
    figure.update_yaxes(title="z [m]", col=1)
    figure.update_xaxes(title="x [m]", row=rows)
    return layout(figure, title).update_layout(showlegend=False)


def extent(scenarios: Sequence[Scenario], tracks: Sequence[Track]) -> tuple[Array, Array]:
    """Return the lower left and upper right corner of the drawing [m]: flights, whole hoops, floor and ceiling.

    A floor or ceiling that is further from all this than its width and height is left out, because it would make the
    flights small.
    """
    posts = [post for world in scenarios for hoop in world.hoops for post in hoop_posts(hoop)]
    points = np.concatenate([*(track.state[:, 0:2] for track in tracks), *posts])
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    reach, (bottom, top) = (high - low).max(), (low[1], high[1])
    for height in (height for world in scenarios for height in (world.floor, world.ceiling)):
        if height is not None and bottom - reach <= height <= top + reach:
            low[1], high[1] = min(low[1], height - MARGIN / 2), max(high[1], height + MARGIN / 2)
    return low, high


def hoop_posts(hoop: Hoop) -> list[Array]:
    """Return the drawn posts of a hoop, lines outwards from the ends of its gap, shape (2, 2) each [m]."""
    return [np.array([rim, rim + side * POST * hoop.across]) for side, rim in zip((-1, 1), hoop.rims, strict=True)]


def add_flight(figure: go.Figure, track: Track, colour: str, vehicles: int, panel: dict[str, int]) -> None:
    """Draw a path, and the vehicle with its thrust at equal time steps."""
    instants = np.linspace(0.0, track.time[-1], vehicles)
    drawn = np.stack([np.interp(instants, track.time, track.state[:, i]) for i in range(5)], axis=-1)
    held = np.clip(np.searchsorted(track.time, instants, side="right") - 1, 0, len(track.time) - 2)
    thrusts = [thrust_line(state, thrust) for state, thrust in zip(drawn, track.control[held, 0], strict=True)]
    for line, name, style in (
        (np.concatenate(thrusts), "thrust", {"color": FLAME, "width": 2}),
        (track.state[:, 0:2], track.name, {"color": colour, "width": 2, "simplify": False}),
        (np.concatenate([vehicle(state) for state in drawn]), "vehicle", {"color": INK, "width": 1.8}),
    ):
        path = name == track.name
        figure.add_scatter(
            x=line[:, 0],
            y=line[:, 1],
            mode="lines",
            name=name,
            line=style,
            text=[f"{t:.3f} s" for t in track.time] if path else None,
            hoverinfo="all" if path else "skip",
            **panel,
        )


def add_scenery(figure: go.Figure, scenario: Scenario, low: Array, high: Array, panel: dict[str, int]) -> None:
    """Draw start, goal, hoops, floor and ceiling."""
    for height, beyond in ((scenario.floor, low[1]), (scenario.ceiling, high[1])):
        if height is not None:
            figure.add_hrect(
                y0=min(height, beyond), y1=max(height, beyond), fillcolor=FAINT, layer="below", line_width=0, **panel
            )
            figure.add_hline(y=height, line={"color": INK, "width": 1.5}, layer="below", **panel)
    for hoop in scenario.hoops:
        for post in hoop_posts(hoop):
            figure.add_scatter(
                x=post[:, 0], y=post[:, 1], mode="lines", name="hoop", line={"color": INK, "width": 5},
                hoverinfo="skip", **panel,
            )  # fmt: skip
    for name, point, symbol in (("start", scenario.start, "circle-open"), ("goal", scenario.goal, "star")):
        figure.add_scatter(
            x=[point[0]], y=[point[1]], mode="markers", name=name, text=name, hoverinfo="text",
            marker={"size": 11, "color": FLAME, "symbol": symbol, "line": {"color": INK, "width": 1.5}}, **panel,
        )  # fmt: skip


def controls(quadrotor: Quadrotor, tracks: Sequence[Track], title: str) -> go.Figure:
    """Return thrust and rate over time with their limits, as the paper's Fig. 6."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.08)
    limits = np.stack([quadrotor.control_low, quadrotor.control_high])
    for row, label in enumerate(("thrust [m/s²]", "rate [rad/s]"), start=1):
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
        # After the traces, because Plotly draws no line into an empty panel.
        low, high = limits[:, row - 1]
        for limit in (low, high):
            figure.add_hline(y=limit, line={"color": OUTLINE, "width": 1, "dash": "dot"}, row=row, col=1)
        room = 0.07 * (high - low)
        figure.update_yaxes(title=label, zeroline=False, range=[low - room, high + room], row=row, col=1)
    figure.update_xaxes(title="time [s]", zeroline=False, row=2, col=1)
    return layout(figure, title)


def learning(curve: Sequence[Mapping[str, Any]], k_star: float, title: str) -> go.Figure:
    """Return the steps of the deterministic episode over the training, against K*.

    Episodes that do not reach the goal are crosses at the height of the longest successful one.
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
        name="deterministic episode",
        line={"color": COLOURS[0], "width": 1.8},
        marker={"size": 5},
    )
    figure.add_hline(
        y=k_star,
        line={"color": INK, "width": 1.5, "dash": "dot"},
        annotation={"text": f"K* = {k_star:.0f} steps", "font": {"color": INK}},
        annotation_position="top left",
    )
    figure.update_yaxes(title="environment steps to the goal", rangemode="normal", zeroline=False)
    figure.update_xaxes(title="environment steps of training", zeroline=False)
    return layout(figure, title)


def write_page(figure: go.Figure, path: Path | str) -> None:
    """Write a figure as an HTML page, complete in one file of some 5 MB.

    Raises:
        ValueError: for another ending than .html.
    """
    write_text(check_output(path, (".html",)), figure.to_html(include_plotlyjs=True, full_html=True))
