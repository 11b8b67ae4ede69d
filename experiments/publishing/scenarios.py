"""The named scenarios: a table with their best-known solutions, and a sheet of pictures, drawn as plain SVG."""

from __future__ import annotations

import numpy as np

from experiments.publishing.markdown import markdown
from flatgym import SCENARIOS, Scenario, reference
from flatgym.quadrotor import Array
from flatgym.scenarios.reference import ghost_states

COLUMNS, TILE, CAPTION, EDGE = 5, 180.0, 26.0, 14.0
"""Tiles in a row; side of a tile's picture, height of its caption, and its inner margin [px]."""
VEHICLE, EVERY = 0.34, 6
"""Drawn length of the vehicle [m], and the steps between two drawings of it."""
INK, PATH, HOOP, GROUND = "#20242a", "#2f6fb3", "#d1495b", "#8a8f98"
OPENING = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" '
    'height="{height:.0f}" font-family="sans-serif" font-size="14">'
)


def table() -> str:
    """Return the named scenarios as a Markdown table: start, goal, hoops, limits, T*, K*."""
    head = ["scenario", "goal [m]", "hoops", "floor [m]", "T* [s]", "K*", "windings"]
    rows = []
    for name, scenario in SCENARIOS.items():
        best = reference(name)
        assert best is not None
        goal = ", ".join(f"{x:g}" for x in scenario.goal)
        floor = "-" if scenario.floor is None else f"{scenario.floor:g}"
        fewest = f"{best.k_star}" if best.proven else f"{best.k_star} (≥ {best.k_lower_bound})"
        hoops = f"{len(scenario.hoops)}" if scenario.hoops else "-"
        rows.append([f"`{name}`", f"({goal})", hoops, floor, f"{best.time:.4f}", fewest, f"{best.winding}"])
    return markdown(head, rows)


def sheet() -> str:
    """Return the pictures of the named scenarios, each with its best-known flight in equal time steps, as SVG."""
    rows = -(-len(SCENARIOS) // COLUMNS)
    width, height = COLUMNS * TILE, rows * (TILE + CAPTION)
    parts = [
        OPENING.format(width=width, height=height),
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="#fff"/>',
    ]
    for i, scenario in enumerate(SCENARIOS.values()):
        left, top = (i % COLUMNS) * TILE, (i // COLUMNS) * (TILE + CAPTION)
        parts.append(f'<g transform="translate({left:.0f} {top:.0f})">{picture(scenario)}</g>')
    return "\n".join([*parts, "</svg>"]) + "\n"


def picture(scenario: Scenario) -> str:
    """Return the elements of one tile."""
    states = ghost_states(scenario)
    ends = [point for hoop in scenario.hoops for point in hoop.rims]
    points = np.array([*states[:, 0:2], scenario.goal, *ends])
    low, high = points.min(axis=0) - VEHICLE / 2, points.max(axis=0) + VEHICLE / 2
    scale = float(min((TILE - 2 * EDGE) / max(*(high - low), 3.0), 60.0))
    middle = (low + high) / 2

    def place(point: Array) -> str:
        x, z = (np.asarray(point) - middle) * scale
        return f"{TILE / 2 + x:.1f},{TILE / 2 + CAPTION - z:.1f}"

    def line(first: Array, last: Array, colour: str, width: float) -> str:
        (x1, y1), (x2, y2) = place(first).split(","), place(last).split(",")
        style = f'stroke="{colour}" stroke-width="{width}" stroke-linecap="round"'
        return f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" {style}/>'

    parts = [f'<text x="{TILE / 2:.0f}" y="18" text-anchor="middle" fill="{INK}">{scenario.name}</text>']
    if scenario.floor is not None:
        wide = (TILE / 2 - EDGE / 2) / scale
        left, right = (np.array([middle[0] + side * wide, scenario.floor]) for side in (-1, 1))
        parts.append(line(left, right, GROUND, 2))
    track = " ".join(place(state[0:2]) for state in states)
    parts.append(f'<polyline points="{track}" fill="none" stroke="{PATH}" stroke-width="1.5"/>')
    for state in states[::EVERY]:
        arm = VEHICLE / 2 * np.array([np.cos(state[4]), -np.sin(state[4])])
        parts.append(line(state[0:2] - arm, state[0:2] + arm, PATH, 2))
    parts += [line(hoop.rims[0], hoop.rims[1], HOOP, 3) for hoop in scenario.hoops]
    for point, fill in ((scenario.start, "#fff"), (scenario.goal, INK)):
        x, y = place(np.array(point)).split(",")
        parts.append(f'<circle cx="{x}" cy="{y}" r="4" fill="{fill}" stroke="{INK}" stroke-width="1.5"/>')
    return "".join(parts)
