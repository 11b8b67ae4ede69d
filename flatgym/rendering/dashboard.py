"""Text of a picture: the score in a header, the meaning of the colours in a footer."""

from __future__ import annotations

from dataclasses import dataclass

from flatgym.rendering.canvas import Canvas, ramp, text_width
from flatgym.rendering.palette import FAILURE, FAINT, GHOST, INK, OUTCOME, PALE, WHITE
from flatgym.scenarios.scenario import Scenario

HEADER, FOOTER = 84.0, 40.0
"""Heights of the two panels [px of a picture of 960 x 720]."""
HEIGHT = HEADER + FOOTER
COLUMN = 104.0
"""Width of a column of the header [px of a picture of 960 x 720]."""
RAMP_WIDTH = 150.0
"""Width of the thrust legend [px of a picture of 960 x 720]."""


@dataclass(frozen=True)
class Reading:
    """Content of the header: scenario, steps, hoops passed, outcome, and K* or None."""

    scenario: Scenario
    steps: int
    hoops_passed: int
    outcome: str
    k_star: int | None

    def columns(self) -> list[tuple[str, str]]:
        """Return labels and values from left to right."""
        columns = [("time", f"{self.steps * self.scenario.dt:.2f} s"), ("steps", f"{self.steps}")]
        if self.scenario.hoops:
            columns.insert(0, ("hoops", f"{self.hoops_passed}/{len(self.scenario.hoops)}"))
        if self.k_star is not None:
            arrived = self.outcome == "goal"
            gap = f"{self.steps / self.k_star - 1:+.1%}" if arrived else "-"
            columns += [("K*", f"{self.k_star}"), ("gap", gap)]
        return columns


def panels(canvas: Canvas, unit: float, scenario: Scenario, with_ghost: bool) -> None:
    """Draw both panels with their constant content: the scenario's name and the legend."""
    width, height = canvas.size
    bottom = height - FOOTER * unit
    canvas.panel(0, 0, width, HEADER * unit, WHITE)
    canvas.panel(0, bottom, width, FOOTER * unit, WHITE)
    for edge in (HEADER * unit, bottom):
        canvas.line([(0, edge), (width, edge)], PALE, 1.5 * unit)
    canvas.text(scenario.name, (20 * unit, 31 * unit), 38 * unit, INK)
    _legend(canvas, unit, scenario, bottom + FOOTER * unit / 2, with_ghost)


def header(canvas: Canvas, unit: float, reading: Reading) -> None:
    """Draw outcome and numbers of the header."""
    colour = OUTCOME.get(reading.outcome, FAILURE)
    wide = text_width(reading.outcome, 19 * unit)
    canvas.panel(20 * unit, 52 * unit, wide + 20 * unit, 22 * unit, colour, 11 * unit)
    canvas.text(reading.outcome, (30 * unit, 64 * unit), 19 * unit, WHITE)
    right = canvas.size[0] - 20 * unit
    for label, value in reversed(reading.columns()):
        canvas.text(label, (right, 23 * unit), 18 * unit, FAINT, "midright")
        canvas.text(value, (right, 53 * unit), 36 * unit, INK if value != "-" else PALE, "midright")
        right -= COLUMN * unit


def _legend(canvas: Canvas, unit: float, scenario: Scenario, middle: float, with_ghost: bool) -> None:
    """Draw the thrust scale and the ghost's line at a height `middle` [px]."""
    quadrotor, size = scenario.quadrotor, 18 * unit
    at = 20 * unit
    at += canvas.text("thrust", (at, middle), size, FAINT) + 10 * unit
    at += canvas.text(f"{quadrotor.thrust_min:g}", (at, middle), size, INK) + 8 * unit
    slices = 75
    for i in range(slices):
        place = at + RAMP_WIDTH * unit * i / slices
        canvas.panel(place, middle - 5 * unit, RAMP_WIDTH * unit / slices + 1, 10 * unit, ramp(i / (slices - 1)))
    at += RAMP_WIDTH * unit + 8 * unit
    at += canvas.text(f"{quadrotor.thrust_max:g} m/s²", (at, middle), size, INK) + 40 * unit
    if with_ghost:
        for dash in (0, 12, 24):
            canvas.line([(at + dash * unit, middle), (at + (dash + 7) * unit, middle)], GHOST, 2 * unit)
        canvas.text("ghost", (at + 40 * unit, middle), size, FAINT)
    canvas.text("metres", (canvas.size[0] - 20 * unit, middle), size, FAINT, "midright")
