"""The named scenarios: a table with their best-known solutions, and two sheets of pictures, drawn as plain SVG.

`sketch` draws any scenario in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import gymnasium as gym
import numpy as np
from imageio.v3 import imwrite
from numpy.typing import ArrayLike

from experiments.files import check_output
from experiments.publishing.markdown import markdown
from flatgym import DISTRIBUTIONS, SCENARIOS, Hoop, Scenario, reference
from flatgym.files import write_text, write_whole
from flatgym.quadrotor import Array
from flatgym.rendering.instant import NEAR
from flatgym.scenarios.reference import ghost_states
from flatgym.scenarios.tracks import TRACKS

COLUMNS, TILE, CAPTION, EDGE = 4, 180.0, 26.0, 14.0
"""Tiles in a row; side of a tile's picture, height of its caption, and its inner margin [px]."""
PANELS = (
    (("split-s", 300.0), ("figure-eight", 360.0), ("ladder", 240.0)),
    (("loop", 300.0), ("slalom", 600.0)),
    (("slalom-6", 900.0),),
    (("zigzag-12", 900.0),),
    tuple((f"random-track-{seed}", 300.0) for seed in range(3)),
)
"""Rows of the sheet of tracks: the name of each picture, or the seed of a sampled track, and its width [px]."""
HEIGHTS = (260.0, 220.0, 170.0, 120.0, 260.0)
"""Heights of the pictures in these rows, without captions [px]."""
VEHICLE, EVERY = 0.34, 6
"""Drawn length of the vehicle [m], and the steps between two drawings of it."""
LARGEST_SCALE = 50.0
"""Largest number of pixels of a metre."""
SKETCH_WIDTH, SKETCH_HEIGHTS, ARROW = 900.0, (240.0, 700.0), 18.0
"""Width and limits of the height of a sketch, and length of the arrow at a hoop [px]."""
PICTURES = (".svg", ".png", ".html")
"""Endings of pictures of a scenario."""
INK, PATH, THRUST, HOOP, GROUND = "#20242a", "#2f6fb3", "#e0a030", "#d1495b", "#8a8f98"
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
    """Return the pictures of the scenarios that are no tracks, with their best-known flights, as SVG."""
    names = [name for name in SCENARIOS if SCENARIOS[name] not in TRACKS]
    rows = [[(name, TILE) for name in names[i : i + COLUMNS]] for i in range(0, len(names), COLUMNS)]
    return drawing(rows, [TILE] * len(rows))


def tracks() -> str:
    """Return the pictures of the named tracks with their best-known flights, and of sampled tracks, as SVG."""
    return drawing(PANELS, HEIGHTS)


def drawing(rows: Sequence[Sequence[tuple[str, float]]], heights: Sequence[float]) -> str:
    """Return rows of pictures as SVG; arguments as PANELS and HEIGHTS."""
    width, height = max(sum(wide for _, wide in row) for row in rows), sum(heights) + CAPTION * len(rows)
    parts = [
        OPENING.format(width=width, height=height),
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="#fff"/>',
    ]
    top = 0.0
    for row, tall in zip(rows, heights, strict=True):
        left = 0.0
        for name, wide in row:
            drawn = picture(name, *scenario_and_flight(name), wide, tall)
            parts.append(f'<g transform="translate({left:.0f} {top:.0f})">{drawn}</g>')
            left += wide
        top += tall + CAPTION
    return "\n".join([*parts, "</svg>"]) + "\n"


def write_sketch(path: Path, scenario: Scenario, states: Array) -> None:
    """Write a picture of a scenario: `sketch` to a .svg or .html file, or the environment's picture to a .png file.

    Args:
        path: the file.
        scenario: the scenario.
        states: of a flight through it, shape (n, 5), or none, shape (0, 5).

    Raises:
        ValueError, OSError: as in `check_output`.
    """
    check_output(path, PICTURES)
    title = f"{scenario.name}: flown in {len(states) - 1} steps" if len(states) else f"{scenario.name}: no flight yet"
    if path.suffix == ".svg":
        write_text(path, sketch(scenario, states, title))
    elif path.suffix == ".html":
        head = f'<!doctype html>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        write_text(path, head + sketch(scenario, states, title))
    else:
        ghost = states if len(states) else False
        env = gym.make("FlatQuad-v0", scenario=scenario, render_mode="rgb_array", ghost=ghost)
        env.reset(seed=0)
        frame = np.asarray(env.render())
        write_whole(path, lambda temporary: imwrite(temporary, frame))
        env.close()


def sketch(scenario: Scenario, states: Array, title: str) -> str:
    """Return a picture of a scenario as SVG, with the numbers of its hoops and arrows in their directions.

    Args:
        scenario: the scenario.
        states: of a flight through it, shape (n, 5), or none, shape (0, 5).
        title: one line.
    """
    across, up = np.ptp(shown(scenario, states, limits=True), axis=0) + VEHICLE
    width, height = SKETCH_WIDTH, float(np.clip(SKETCH_WIDTH * up / across, *SKETCH_HEIGHTS)) + 2 * EDGE
    parts = [
        OPENING.format(width=width, height=height + CAPTION),
        f'<rect width="{width:.0f}" height="{height + CAPTION:.0f}" fill="#fff"/>',
        picture(title, scenario, states, width, height, numbered=True),
    ]
    return "\n".join([*parts, "</svg>"]) + "\n"


def picture(title: str, scenario: Scenario, states: Array, width: float, height: float, numbered: bool = False) -> str:
    """Return the elements of one picture: a scenario with a flight, or with straight lines if `states` is empty."""
    points = shown(scenario, states, limits=numbered)
    frame = Frame.of(points, width, height, math.inf if numbered else LARGEST_SCALE)
    parts = [f'<text x="{width / 2:.0f}" y="18" text-anchor="middle" fill="{INK}">{escape(title)}</text>']
    parts += [frame.level(limit) for limit in (scenario.floor, scenario.ceiling) if limit is not None]
    if len(states):
        parts.append(frame.polyline(states[:, 0:2], f'stroke="{PATH}" stroke-width="1.5"'))
    else:
        corners = np.array([scenario.start, *(hoop.centre for hoop in scenario.hoops), scenario.goal])
        parts.append(frame.polyline(corners, f'stroke="{GROUND}" stroke-dasharray="4 3"'))
    for x, z, _, _, theta in states[::EVERY]:
        centre, sin, cos = np.array([x, z]), np.sin(theta), np.cos(theta)
        parts.append(frame.line(centre, centre + VEHICLE / 2 * np.array([sin, cos]), THRUST, 1.5))
        arm = VEHICLE / 2 * np.array([cos, -sin])
        parts.append(frame.line(centre - arm, centre + arm, PATH, 2))
    parts += [frame.line(hoop.rims[0], hoop.rims[1], HOOP, 3) for hoop in scenario.hoops]
    if numbered:
        parts += [frame.arrow(hoop, f"{i}") for i, hoop in enumerate(scenario.hoops, start=1)]
    parts += [frame.dot(scenario.start, 5.5, "#fff"), frame.dot(scenario.goal, 4, INK)]
    return "".join(parts)


def shown(scenario: Scenario, states: Array, limits: bool) -> Array:
    """Return the points that a picture has to show [m], shape (n, 2); with `limits`, also floor and ceiling if near."""
    rims = [rim for hoop in scenario.hoops for rim in hoop.rims]
    points = np.array([*states[:, 0:2], scenario.start, scenario.goal, *rims])
    heights = [height for height in scenario.heights if limits and np.abs(points[:, 1] - height).min() <= NEAR]
    return np.array([*points, *((scenario.start[0], height) for height in heights)])


def scenario_and_flight(name: str) -> tuple[Scenario, Array]:
    """Return a named scenario and the states of its best-known flight, or a sampled scenario and no states."""
    if name in SCENARIOS:
        return SCENARIOS[name], ghost_states(name)
    distribution, _, seed = name.rpartition("-")
    return DISTRIBUTIONS[distribution].scenario(int(seed)), np.zeros((0, 5))


@dataclass(frozen=True)
class Frame:
    """The mapping from metres to the pixels of one picture, and the SVG elements in it.

    Attributes:
        middle: the point at the picture's centre [m], shape (2,).
        scale: pixels of a metre.
        width, height: of the picture without its caption [px].
    """

    middle: Array
    scale: float
    width: float
    height: float

    @classmethod
    def of(cls, points: Array, width: float, height: float, largest: float) -> Frame:
        """Return the frame that shows points, shape (n, 2), and a vehicle at each; `largest` is the largest scale."""
        low, high = points.min(axis=0) - VEHICLE / 2, points.max(axis=0) + VEHICLE / 2
        fits = (np.array([width, height]) - 2 * EDGE) / (high - low)
        return cls((low + high) / 2, float(min(*fits, largest)), width, height)

    def place(self, point: ArrayLike) -> tuple[float, float]:
        """Return the pixels of a point [m]."""
        x, z = (np.asarray(point) - self.middle) * self.scale
        return round(self.width / 2 + float(x), 1), round(self.height / 2 + CAPTION - float(z), 1)

    def line(self, first: ArrayLike, last: ArrayLike, colour: str, width: float) -> str:
        """Return a straight line between two points."""
        (x1, y1), (x2, y2) = self.place(first), self.place(last)
        style = f'stroke="{colour}" stroke-width="{width}" stroke-linecap="round"'
        return f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" {style}/>'

    def polyline(self, points: Array, style: str) -> str:
        """Return the line through points, shape (n, 2)."""
        corners = " ".join(f"{x},{y}" for x, y in map(self.place, points))
        return f'<polyline points="{corners}" fill="none" {style}/>'

    def arrow(self, hoop: Hoop, number: str) -> str:
        """Return an arrow in the direction of a hoop, and its number beside its upper end."""
        tip, size = hoop.centre + ARROW / self.scale * hoop.direction, ARROW / 3 / self.scale
        wings = [tip - size * (hoop.direction + side * hoop.across) for side in (-1, 1)]
        lines = [(hoop.centre, tip), (tip, wings[0]), (tip, wings[1])]
        x, y = self.place(hoop.rims[1] + 12 / self.scale * hoop.across)
        label = f'<text x="{x}" y="{y + 4}" text-anchor="middle" font-size="12" fill="{HOOP}">{number}</text>'
        return "".join(self.line(one, other, HOOP, 1) for one, other in lines) + label

    def level(self, height: float) -> str:
        """Return a line at a height [m], across the picture."""
        half = (self.width - EDGE) / 2 / self.scale
        return self.line((self.middle[0] - half, height), (self.middle[0] + half, height), GROUND, 2)

    def dot(self, point: ArrayLike, radius: float, fill: str) -> str:
        """Return a dot with a dark rim."""
        x, y = self.place(point)
        return f'<circle cx="{x}" cy="{y}" r="{radius}" fill="{fill}" stroke="{INK}" stroke-width="1.5"/>'
