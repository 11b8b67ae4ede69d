"""The static part of a picture: grid, floor and ceiling, start and goal, the ghost's path, and the hoops.

A hoop is drawn as a ring in perspective. Its far half is part of the backdrop; its near half is drawn over the vehicle,
so the vehicle appears to pass through. Colours distinguish the next hoop, later hoops, and passed hoops.
"""

from __future__ import annotations

import math

import numpy as np

from flatgym.quadrotor import Array
from flatgym.rendering import dashboard
from flatgym.rendering.canvas import Camera, Canvas, Colour, View, mix, text_width
from flatgym.rendering.palette import (
    AHEAD,
    BAND,
    FAINT,
    GHOST,
    GOAL,
    GRID,
    GRID_MAIN,
    HATCH,
    INK,
    NEXT,
    PAPER,
    PASSED,
    WHITE,
)
from flatgym.scenarios.scenario import Hoop, Scenario

GRID_STEPS = tuple(digit * 10**power for power in range(7) for digit in (1, 2, 5))
"""Candidates for the distance of grid lines [m]."""


class Backdrop:
    """Draws the static part, all of it or the near halves of the hoops.

    Args:
        scenario: the scenario.
        unit: scale of the picture relative to 960 x 720 pixels.
    """

    def __init__(self, scenario: Scenario, unit: float) -> None:
        self.scenario, self.unit = scenario, unit

    def draw(self, canvas: Canvas, camera: Camera, hoops_passed: int, ghost: Array | None) -> None:
        """Draw everything; `ghost` are the states of the trajectory whose path is shown, shape (n, 5), or None."""
        canvas.panel(*camera.view, PAPER)
        canvas.clip(camera.view)
        self._grid(canvas, camera)
        self._bands(canvas, camera)
        self._ends(canvas, camera)
        if ghost is not None:
            path, unit = camera(ghost[:, 0:2]), self.unit
            canvas.dashes(path, mix(GHOST, PAPER, 0.75), 1.5 * unit, 7 * unit, 5 * unit)
        self.hoops(canvas, camera, hoops_passed, near=False)
        canvas.clip(None)
        dashboard.panels(canvas, self.unit, self.scenario, ghost is not None)

    def hoops(self, canvas: Canvas, camera: Camera, passed: int, near: bool) -> None:
        """Draw the near halves of the rings, or the far halves with arrows and numbers."""
        # The next hoop is drawn last, on top of others at the same place.
        for i, hoop in sorted(enumerate(self.scenario.hoops), key=lambda item: (item[0] == passed, item[0] > passed)):
            colour = PASSED if i < passed else NEXT if i == passed else AHEAD
            self._half_ring(canvas, camera, hoop, colour, near, bold=i == passed)
            if not near:
                self._direction(canvas, camera, hoop, colour)
                self._badge(canvas, camera, i, colour)

    def _grid(self, canvas: Canvas, camera: Camera) -> None:
        low_x, low_z, high_x, high_z = camera.seen
        unit, (left, top, width, height) = self.unit, camera.view
        step = next((s for s in GRID_STEPS if s * camera.scale >= 38 * unit), GRID_STEPS[-1])
        xs, zs = (
            step * np.arange(math.ceil(low / step), high / step) for low, high in ((low_x, high_x), (low_z, high_z))
        )
        across = [(x, float(camera((x, 0.0))[0])) for x in xs]
        up = [(z, float(camera((0.0, z))[1])) for z in zs]
        for x, at in across:
            canvas.line([(at, top), (at, top + height)], GRID_MAIN if x == 0 else GRID, 1.2 * unit)
        for z, at in up:
            canvas.line([(left, at), (left + width, at)], GRID_MAIN if z == 0 else GRID, 1.2 * unit)
        for x, at in across:
            self._label(canvas, f"{x:g}", at + 4 * unit, top + height - 9 * unit)
        for z, at in up:
            # The corners hold other labels.
            if top + 20 * unit < at < top + height - 26 * unit:
                self._label(canvas, f"{z:g}", left + 6 * unit, at - 8 * unit)

    def _label(self, canvas: Canvas, text: str, left: float, middle: float) -> None:
        unit = self.unit
        canvas.panel(left - unit, middle - 6 * unit, text_width(text, 16 * unit) + 2 * unit, 11 * unit, PAPER)
        canvas.text(text, (left, middle), 16 * unit, FAINT)

    def _bands(self, canvas: Canvas, camera: Camera) -> None:
        unit, (left, top, width, height) = self.unit, camera.view
        for limit, below, label in ((self.scenario.floor, True, "floor"), (self.scenario.ceiling, False, "ceiling")):
            if limit is None:
                continue
            edge = float(np.clip(camera((0.0, limit))[1], top, top + height))
            begin, end = (edge, top + height) if below else (top, edge)
            if end - begin < 1:
                continue
            self._hatch(canvas, (left, begin, width, end - begin))
            canvas.clip(camera.view)
            canvas.line([(left, edge), (left + width, edge)], INK, 2.5 * unit)
            place = (left + width - 12 * unit, edge + (16 if below else -16) * unit)
            canvas.text(label, place, 18 * unit, mix(INK, BAND, 0.7), "midright")

    def _hatch(self, canvas: Canvas, area: View) -> None:
        left, top, width, height = area
        canvas.clip(area)
        canvas.panel(*area, BAND)
        for x in np.arange(left - height, left + width, 14 * self.unit):
            canvas.line([(x, top + height), (x + height, top)], HATCH, 2 * self.unit)

    def _ends(self, canvas: Canvas, camera: Camera) -> None:
        unit, start, goal = self.unit, camera(self.scenario.start), camera(self.scenario.goal)
        canvas.ring(start, 8 * unit, FAINT, 2 * unit)
        canvas.disc(start, 3 * unit, FAINT)
        # The inner circle is the position tolerance, enlarged if it is too small to see.
        radius = max(self.scenario.tolerance.position * camera.scale, 4 * unit)
        canvas.disc(goal, radius + 12 * unit, mix(GOAL, PAPER, 0.14))
        canvas.disc(goal, radius, mix(GOAL, PAPER, 0.4))
        canvas.ring(goal, radius, GOAL, 2 * unit)
        for towards in np.array([(1, 0), (0, 1), (-1, 0), (0, -1)]):
            canvas.line([goal + towards * (radius + 5 * unit), goal + towards * (radius + 12 * unit)], GOAL, 2 * unit)
        # Labels are on the far side of start and goal, away from the path; below if both are at similar heights.
        down, slack = np.array([0.0, radius + 26 * unit]), 30 * unit
        for label, place, other, colour in (("start", start, goal, FAINT), ("goal", goal, start, GOAL)):
            below = other[1] < place[1] + slack
            canvas.text(label, place + (down if below else -down), 19 * unit, colour, "center")

    def _half_ring(self, canvas: Canvas, camera: Camera, hoop: Hoop, colour: Colour, near: bool, bold: bool) -> None:
        unit, centre, half = self.unit, camera(hoop.centre), hoop.diameter / 2 * camera.scale
        across, along = _on_screen(hoop.across), _on_screen(hoop.direction)
        turn = np.linspace(-np.pi / 2, np.pi / 2, 17)[:, None] + (np.pi if near else 0.0)
        depth = min(0.2 * half, 9 * unit)
        ring = centre + half * np.sin(turn) * across + depth * np.cos(turn) * along
        canvas.line(ring, colour if near else mix(colour, PAPER, 0.55), (4 if bold else 3) * unit, smooth=True)
        if near:
            for side in (-1, 1):
                canvas.disc(centre + side * half * across, (4.5 if bold else 3.5) * unit, colour)

    def _direction(self, canvas: Canvas, camera: Camera, hoop: Hoop, colour: Colour) -> None:
        centre, along = camera(hoop.centre), _on_screen(hoop.direction)
        canvas.arrow(centre + 16 * self.unit * along, centre + 42 * self.unit * along, colour, 2.5 * self.unit)

    def _badge(self, canvas: Canvas, camera: Camera, i: int, colour: Colour) -> None:
        """Draw the number of hoop i beyond its rim; the numbers of hoops at the same place are in a row."""
        hoop, unit = self.scenario.hoops[i], self.unit
        before = sum(math.dist((hoop.x, hoop.z), (other.x, other.z)) < 1e-6 for other in self.scenario.hoops[:i])
        outwards = _on_screen(hoop.across if hoop.across[1] >= -1e-9 else -hoop.across)
        place = camera(hoop.centre) + (hoop.diameter / 2 * camera.scale + (20 + 26 * before) * unit) * outwards
        canvas.disc(place, 11 * unit, colour)
        canvas.text(f"{i + 1}", place + np.array([0.0, unit]), 19 * unit, WHITE, "center")


def _on_screen(direction: Array) -> Array:
    """Return a direction (2,) in screen axes, whose second points down."""
    return direction * (1, -1)
