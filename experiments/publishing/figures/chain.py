"""The figures of the chain bound: gap against time, work against the number of hoops, and the windows of one proof."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from experiments.figures import COLOURS, FAINT, INK, OUTLINE, Track, add_flight, add_scenery, decades, layout
from experiments.files import Row
from flatgym import SCENARIOS
from flatgym.quadrotor import Array
from optimal.direct.multistart import search
from optimal.direct.shooting import ShootingSolution
from optimal.proof.branch_and_bound import ExcludedBranch
from optimal.proof.branches import Branch
from optimal.proof.lower_bound import Proof, prove_near
from optimal.proof.programme.stations import Interval, Passing, Problem
from optimal.proof.stages import passing_left

CONVERGENCE, HOOPS, EXPLANATION = "chain-convergence.svg", "chain-hoops.svg", "chain-windows.svg"
"""File names of the figures."""
EXPLAINED, EXPLAINED_GAP, EXPLAINED_BUDGET = "slalom", 1e-3, 100.0
"""Scenario of the explanation, requested gap of its proof, and time budget [s]."""
ZOOM = 0.13
"""Half the range of the time axes of the explanation [s]."""
REFERENCE_LINES = {1: "proportional to hoops", 3: "proportional to hoops cubed"}
"""Names of the reference lines by slope."""
SHADES = ("#dfe4e8", "#a9cbd9", "#6ea9c2", "#3b89ab", "#0b6e99", "#075573", "#04394d")
"""Colours of the grids of the explanation, from coarse to fine."""


def convergence_figure(rows: Sequence[Row]) -> go.Figure:
    """Return the gap of each scenario against the wall time of its proof, on logarithmic axes."""
    figure = go.Figure()
    for name, colour in zip(dict.fromkeys(row["scenario"] for row in rows), COLOURS, strict=False):
        own = [row for row in rows if row["scenario"] == name]
        figure.add_scatter(
            x=[row["wall_time_s"] for row in own], y=[row["gap"] for row in own], mode="lines+markers", name=name,
            line={"color": colour, "width": 2}, marker={"size": 8},
        )  # fmt: skip
    figure.update_xaxes(title="wall time of the proof [s]", **decades())
    figure.update_yaxes(title="gap between flight and bound", **decades(percent=True))
    return layout(figure, "A smaller gap takes a longer proof").update_layout(width=800, height=460)


def hoops_figure(rows: Sequence[Row]) -> go.Figure:
    """Return processor time and evaluations by number of hoops, with lines of slopes 1 and 3 through their middle.

    The slalom's duration grows with its hoops, so hoops times the square of the instants has the slope 3. Proofs that
    spent their budget before the requested gap are open circles.
    """
    figure = make_subplots(rows=1, cols=2, horizontal_spacing=0.12)
    counts = np.array([row["hoops"] for row in rows], dtype=float)
    closed = [row["gap"] is not None and row["gap"] <= row["gap_asked"] for row in rows]
    for column, (key, slopes) in enumerate({"processor_time_s": (1, 3), "evaluations": (1,)}.items(), start=1):
        work, panel = np.array([row[key] for row in rows], dtype=float), {"row": 1, "col": column}
        for slope in slopes:
            scale = np.exp(np.mean(np.log(work / counts**slope)))
            figure.add_scatter(
                x=counts, y=scale * counts**slope, mode="lines", showlegend=column == 1, name=REFERENCE_LINES[slope],
                line={"color": OUTLINE, "width": 1.5, "dash": "dot" if slope == 1 else "dash"}, **panel,
            )  # fmt: skip
        figure.add_scatter(
            x=counts, y=work, mode="lines+markers", name="proof (open circle: budget spent)",
            line={"color": COLOURS[0], "width": 2}, showlegend=column == 1,
            marker={
                "size": 9, "color": [COLOURS[0] if done else "white" for done in closed],
                "line": {"color": COLOURS[0], "width": 2},
            }, **panel,
        )  # fmt: skip
    figure.update_xaxes(title="hoops", type="log", tickvals=counts, ticktext=[f"{count:.0f}" for count in counts])
    figure.update_yaxes(title="processor time of the proof [s]", **decades(), col=1)
    figure.update_yaxes(title="evaluations of F", **decades(), col=2)
    return layout(figure, "Work against the number of hoops of the slalom").update_layout(
        width=1000, height=480, legend={"y": -0.2, "yanchor": "top", "x": 0.5, "xanchor": "center"}, margin={"b": 100}
    )


class Cut(NamedTuple):
    """The windows after one grid of a proof.

    Attributes:
        angles: angles of a turn of the grid; 0 before the first one.
        windows: intervals of the passing times by hoop [s]; empty where the grid left no flight.
    """

    angles: int
    windows: tuple[Interval, ...]


def cuts(proof: Proof, excluded: ExcludedBranch) -> list[Cut]:
    """Return the windows of a branch before its first grid and after each grid, recomputed from its multipliers."""
    problem = Problem(proof.scenario, proof.tolerance, proof.time, proof.kinks, proof.steps)
    passing: Passing | None = Passing.possible(problem)
    assert passing is not None
    found = [Cut(0, passing.windows)]
    common = [(Branch(), stage) for stage in proof.common]
    for branch, stage in [*common, *((excluded.branch, stage) for stage in excluded.stages)]:
        passing = passing_left(problem, branch, [stage], passing)
        if found[-1].angles == stage.grid.turn:
            found.pop()
        if passing is None:
            return [*found, Cut(stage.grid.turn, ())]
        found.append(Cut(stage.grid.turn, passing.windows))
    return found


def explanation() -> go.Figure:
    """Return the path of a flight with its stations, and the windows of its passing times from grid to grid."""
    shot = search(SCENARIOS[EXPLAINED]).shots[0]
    proof = prove_near(SCENARIOS[EXPLAINED], shot, max_gap=EXPLAINED_GAP, time_budget=EXPLAINED_BUDGET)
    ours = [each for each in proof.excluded if each.branch.winding in (None, shot.winding)]
    longest = max(ours, key=lambda each: len(cuts(proof, each)))
    return windows_figure(shot, proof, cuts(proof, longest))


def windows_figure(shot: ShootingSolution, proof: Proof, found: Sequence[Cut]) -> go.Figure:
    """Return the figure of a flight and of the windows that a proof leaves for its passing times."""
    passing = passing_times(shot)
    columns = len(passing)
    titles = ["", *(f"hoop {i + 1}" for i in range(columns))]
    figure = make_subplots(
        rows=2, cols=columns, specs=[[{"colspan": columns}, *[None] * (columns - 1)], [{}] * columns],
        subplot_titles=titles, row_heights=[0.55, 0.45], vertical_spacing=0.18, horizontal_spacing=0.04,
    )  # fmt: skip
    draw_path(figure, shot, proof, passing)
    labels = [label(cut) for cut in found]
    for column, time in enumerate(passing, start=1):
        for cut, name, colour in zip(found, labels, SHADES, strict=False):
            low, high = cut.windows[column - 1] if cut.windows else (time, time)
            figure.add_bar(
                base=[low], x=[high - low], y=[name], orientation="h", marker={"color": colour}, showlegend=False,
                row=2, col=column,
            )  # fmt: skip
        figure.add_vline(x=time, line={"color": COLOURS[1], "width": 2, "dash": "dot"}, row=2, col=column)
        figure.update_xaxes(
            range=[time - ZOOM, time + ZOOM], tickformat=".2f", dtick=0.05, zeroline=False, title="passing time [s]",
            row=2, col=column,
        )  # fmt: skip
        figure.update_yaxes(
            categoryorder="array", categoryarray=labels[::-1], showticklabels=column == 1, gridcolor=FAINT,
            row=2, col=column,
        )  # fmt: skip
    less = f"{proof.time:.4f} s, {100 * proof.gap:.2f} % below the flown time"
    title = f"{proof.scenario.name}: windows of the passing times in flights of {less}"
    return layout(figure, title).update_layout(
        width=1000, height=700, bargap=0.25, showlegend=False, margin={"l": 150, "t": 60}
    )


def label(cut: Cut) -> str:
    """Return what an axis calls the windows after a grid."""
    if not cut.angles:
        return "projection bound"
    return f"{cut.angles} angles" + ("" if cut.windows else ": none left")


def passing_times(shot: ShootingSolution) -> Array:
    """Return the times at which a flight passes the hoops [s], shape (m,)."""
    return shot.trajectory.breakpoints[np.cumsum(shot.steps)[:-1]]


def draw_path(figure: go.Figure, shot: ShootingSolution, proof: Proof, passing: Array) -> None:
    """Draw the path of a flight in the first row, with its stations and their passing times."""
    samples, panel = shot.trajectory.sample(0.002), {"row": 1, "col": 1}
    around = np.array([0.7, 1.4])
    low, high = samples.state[:, 0:2].min(axis=0) - around, samples.state[:, 0:2].max(axis=0) + around
    add_flight(figure, Track("flight", samples.time, samples.state, samples.control), COLOURS[0], 26, panel)
    add_scenery(figure, proof.scenario, low, high, panel)
    scenario = proof.scenario
    stations = [("start", scenario.start, 0.0), ("goal", scenario.goal, shot.trajectory.duration)]
    stations += [(f"hoop {i + 1}", (h.x, h.z), t) for i, (h, t) in enumerate(zip(scenario.hoops, passing, strict=True))]
    for name, (x, z), time in stations:
        figure.add_annotation(
            x=x, y=z + (np.copysign(0.95, z) if name.startswith("hoop") else -0.5), text=f"{name}, {time:.2f} s",
            showarrow=False, font={"size": 13, "color": INK}, **panel,
        )  # fmt: skip
    common = {"zeroline": False, "constrain": "domain", "dtick": 1}
    figure.update_yaxes(title="z [m]", scaleanchor="x", range=[low[1], high[1]], **common, **panel)
    figure.update_xaxes(title="x [m]", range=[low[0], high[0]], **common, **panel)
