"""What a flight looks like: the world from the side, the vehicle, its trail, and a ghost to fly against.

The camera sees start, goal, hoops and ghost, and draws back when the vehicle leaves what it sees; so it
is a function of the flight and the same flight gives the same picture. The trail is coloured by the thrust. A
hoop is a ring seen aslant: its far half is drawn behind the vehicle, its near half before it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flatgym import dashboard
from flatgym.canvas import Camera, Canvas, Colour, Pixels, mix, ramp
from flatgym.palette import (
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
    PALE,
    PAPER,
    PASSED,
    ROTOR,
    WHITE,
)
from flatgym.quadrotor import Array
from flatgym.scenario import Hoop, Scenario

MARGIN = 0.9
"""What is seen beyond start, goal, hoops and ghost [m]."""
ROOM = 0.5
"""What is seen beyond the vehicle [m]."""
ARM = 0.2
"""Half the width of the drawn quadrotor [m], within what is seen well."""


@dataclass(frozen=True, eq=False)
class Instant:
    """How a flight stands.

    Attributes:
        states: flown so far, from the start on, shape (k+1, 5).
        thrusts: of the k steps flown [m/s^2], shape (k,).
        hoops_passed: how many.
        outcome: a word of flatgym.OUTCOMES.
    """

    states: Array
    thrusts: Array
    hoops_passed: int = 0
    outcome: str = "flying"

    @property
    def steps(self) -> int:
        """Steps flown."""
        return len(self.thrusts)


class Picture:
    """Pictures of flights through one scenario, all of one size.

    Args:
        scenario: what is flown.
        size: width and height [px].
        k_star: the fewest steps known, or None.
        ghost: states of another flight, shape (n, 5), or None.
    """

    def __init__(self, scenario: Scenario, size: tuple[int, int], k_star: int | None, ghost: Array | None) -> None:
        self.scenario, self.k_star, self.ghost = scenario, k_star, ghost
        self.unit = min(size[0] / 960, size[1] / 720)
        """Pixels of what is a pixel in a picture of 960 x 720."""
        self.canvas, self._world = Canvas(size, PAPER), Canvas(size, PAPER)
        self.view = (0.0, dashboard.HEADER * self.unit, float(size[0]), size[1] - dashboard.HEIGHT * self.unit)
        self.box = box_of_interest(scenario, ghost)
        self._drawn: tuple[Camera, bool] | None = None

    def camera(self, states: Array) -> Camera:
        """Return the camera that sees what is of interest and all states (n, 5)."""
        low, high = states[:, 0:2].min(axis=0) - ROOM, states[:, 0:2].max(axis=0) + ROOM
        box = np.concatenate([np.minimum(self.box[0:2], low), np.maximum(self.box[2:4], high)])
        return Camera.fit(box, self.view, scale_most=150 * self.unit)

    def draw(self, instant: Instant, with_ghost: bool = True) -> Canvas:
        """Return the sheet with the flight as it stands; the next call draws over it."""
        camera, canvas = self.camera(instant.states), self.canvas
        with_ghost = with_ghost and self.ghost is not None
        self._draw_world(camera, with_ghost)
        canvas.put(self._world)
        canvas.clip(self.view)
        self._hoops(camera, instant.hoops_passed, near=False)
        self._trail(camera, instant)
        if with_ghost:
            self._ghost(camera, instant.steps)
        self._vehicle(camera, instant)
        self._hoops(camera, instant.hoops_passed, near=True)
        canvas.clip(None)
        reading = dashboard.Reading(self.scenario, instant.steps, instant.hoops_passed, instant.outcome, self.k_star)
        dashboard.header(canvas, self.unit, reading)
        return canvas

    def pixels(self, instant: Instant, with_ghost: bool = True) -> Pixels:
        """Return the picture as red, green and blue, shape (height, width, 3)."""
        return self.draw(instant, with_ghost).pixels()

    # What stands still is drawn once for each camera.

    def _draw_world(self, camera: Camera, with_ghost: bool) -> None:
        if self._drawn == (camera, with_ghost):
            return
        self._drawn = (camera, with_ghost)
        self._world.surface.fill(PAPER)
        self._grid(camera)
        self._bands(camera)
        self._ends(camera)
        if with_ghost and self.ghost is not None:
            self._world.dashes(camera(self.ghost[:, 0:2]), mix(GHOST, PAPER, 0.75), 1.5 * self.unit, 7 * self.unit, 5 * self.unit)
        dashboard.panels(self._world, self.unit, self.scenario, with_ghost)

    def _grid(self, camera: Camera) -> None:
        low_x, low_z, high_x, high_z = camera.seen
        step = next(s for s in (1, 2, 5, 10, 20, 50, 100, 1000, 1e4, 1e5, 1e6, 1e7) if s * camera.scale >= 38 * self.unit)
        left, top, width, height = self.view
        for x in np.arange(np.ceil(low_x / step), high_x / step) * step:
            at = camera((x, 0.0))[0]
            self._world.line([(at, top), (at, top + height)], GRID_MAIN if x == 0 else GRID, 1.2 * self.unit)
            self._world.words(f"{x:g}", (at + 4 * self.unit, top + height - 9 * self.unit), 14 * self.unit, FAINT)
        for z in np.arange(np.ceil(low_z / step), high_z / step) * step:
            at = camera((0.0, z))[1]
            self._world.line([(left, at), (left + width, at)], GRID_MAIN if z == 0 else GRID, 1.2 * self.unit)
            if top + 20 * self.unit < at < top + height - 26 * self.unit:
                self._world.words(f"{z:g}", (left + 6 * self.unit, at - 8 * self.unit), 14 * self.unit, FAINT)

    def _bands(self, camera: Camera) -> None:
        left, top, width, height = self.view
        for limit, below, word in ((self.scenario.floor, True, "floor"), (self.scenario.ceiling, False, "ceiling")):
            if limit is None:
                continue
            edge = float(np.clip(camera((0.0, limit))[1], top, top + height))
            begin, end = (edge, top + height) if below else (top, edge)
            if end - begin < 1:
                continue
            self._hatch((left, begin, width, end - begin))
            self._world.line([(left, edge), (left + width, edge)], INK, 2.5 * self.unit)
            place = (left + width - 12 * self.unit, edge + (16 if below else -16) * self.unit)
            self._world.words(word, place, 18 * self.unit, mix(INK, BAND, 0.7), "midright")

    def _hatch(self, area: tuple[float, float, float, float]) -> None:
        left, top, width, height = area
        self._world.clip(area)
        self._world.panel(*area, BAND)
        for x in np.arange(left - height, left + width, 14 * self.unit):
            self._world.line([(x, top + height), (x + height, top)], HATCH, 2 * self.unit)
        self._world.clip(None)

    def _ends(self, camera: Camera) -> None:
        unit, world = self.unit, self._world
        start, goal = camera(self.scenario.start), camera(self.scenario.goal)
        world.ring(start, 8 * unit, FAINT, 2 * unit)
        world.disc(start, 3 * unit, FAINT)
        radius = max(self.scenario.tolerance.position * camera.scale, 4 * unit)
        world.disc(goal, radius + 12 * unit, mix(GOAL, PAPER, 0.14))
        world.disc(goal, radius, mix(GOAL, PAPER, 0.4))
        world.ring(goal, radius, GOAL, 2 * unit)
        for turn in np.arange(4) * np.pi / 2:
            towards = np.array([np.cos(turn), np.sin(turn)])
            world.line([goal + towards * (radius + 5 * unit), goal + towards * (radius + 12 * unit)], GOAL, 2 * unit)
        for word, place, colour in (("start", start, FAINT), ("goal", goal, GOAL)):
            world.words(word, place + np.array([0.0, 30 * unit]), 19 * unit, colour, "center")

    # What moves is drawn each time.

    def _hoops(self, camera: Camera, passed: int, near: bool) -> None:
        hoops = list(enumerate(self.scenario.hoops))
        # The next one lies on top of others in the same place.
        for i, hoop in sorted(hoops, key=lambda item: (item[0] == passed, item[0] > passed)):
            colour = PASSED if i < passed else NEXT if i == passed else AHEAD
            self._half_ring(camera, hoop, colour, near, bold=i == passed)
            if near:
                self._badge(camera, hoop, i, colour)

    def _half_ring(self, camera: Camera, hoop: Hoop, colour: Colour, near: bool, bold: bool) -> None:
        unit, centre, half = self.unit, camera(hoop.centre), hoop.diameter / 2 * camera.scale
        # The screen's vertical axis points down.
        across, along = hoop.across * (1, -1), hoop.direction * (1, -1)
        turn = np.linspace(-np.pi / 2, np.pi / 2, 25)[:, None] + (np.pi if near else 0.0)
        depth = min(0.2 * half, 9 * unit)
        ring = centre + half * np.sin(turn) * across + depth * np.cos(turn) * along
        self.canvas.line(ring, colour if near else mix(colour, PAPER, 0.55), (4 if bold else 3) * unit)
        if near:
            for side in (-1, 1):
                self.canvas.disc(centre + side * half * across, (4.5 if bold else 3.5) * unit, colour)
        else:
            self._chevron(centre + 20 * unit * along, along, across, colour)

    def _chevron(self, tip: Array, along: Array, across: Array, colour: Colour) -> None:
        wing = 6 * self.unit
        back = tip - wing * along
        self.canvas.line([back + wing * across, tip, back - wing * across], colour, 2.5 * self.unit)

    def _badge(self, camera: Camera, hoop: Hoop, i: int, colour: Colour) -> None:
        """Draw the number beyond the rim; hoops in one place have theirs in a row."""
        before = sum(np.hypot(*(hoop.centre - other.centre)) < 1e-6 for other in self.scenario.hoops[:i])
        outwards = hoop.across * (1, -1) if hoop.across[1] >= -1e-9 else -hoop.across * (1, -1)
        away = hoop.diameter / 2 * camera.scale + (20 + 26 * before) * self.unit
        place = camera(hoop.centre) + away * outwards
        self.canvas.disc(place, 11 * self.unit, colour)
        self.canvas.words(f"{i + 1}", place + np.array([0.0, 1.0]) * self.unit, 19 * self.unit, WHITE, "center")

    def _share(self, thrust: float) -> float:
        quadrotor = self.scenario.quadrotor
        return float((thrust - quadrotor.thrust_min) / (quadrotor.thrust_max - quadrotor.thrust_min))

    def _trail(self, camera: Camera, instant: Instant) -> None:
        places = camera(instant.states[:, 0:2])
        for start, end, thrust in zip(places[:-1], places[1:], instant.thrusts, strict=True):
            self.canvas.line([start, end], ramp(self._share(thrust)), 4.5 * self.unit)

    def _arm(self, camera: Camera) -> float:
        return float(np.clip(ARM * camera.scale, 19 * self.unit, 30 * self.unit))

    def _ghost(self, camera: Camera, steps: int) -> None:
        assert self.ghost is not None
        arm = self._arm(camera)
        side = int(np.ceil(4 * arm))
        sheet, state = Canvas((side, side)), self.ghost[min(steps, len(self.ghost) - 1)]
        quadrotor(sheet, np.full(2, side / 2), state[4], arm, GHOST, GHOST)
        self.canvas.put(sheet, camera(state[0:2]) - side / 2, opacity=0.5)

    def _vehicle(self, camera: Camera, instant: Instant) -> None:
        state, arm = instant.states[-1], self._arm(camera)
        centre = camera(state[0:2])
        if instant.steps and instant.outcome == "flying":
            self._thrust(centre, state[4], float(instant.thrusts[-1]), arm)
        quadrotor(self.canvas, centre, state[4], arm, INK, ROTOR)

    def _thrust(self, centre: Array, theta: float, thrust: float, arm: float) -> None:
        up, right = np.array([np.sin(theta), -np.cos(theta)]), np.array([np.cos(theta), np.sin(theta)])
        share = thrust / self.scenario.quadrotor.thrust_max
        tip, wing = centre + (0.5 + 2.1 * share) * arm * up, 5.5 * self.unit
        neck = tip - 1.6 * wing * up
        for colour, more in ((PAPER, 3.0), (ramp(self._share(thrust)), 0.0)):
            self.canvas.line([centre, neck], colour, 3.5 * self.unit + more)
        self.canvas.area([tip, neck + wing * right, neck - wing * right], colour)


def box_of_interest(scenario: Scenario, ghost: Array | None) -> Array:
    """Return least x, least z, greatest x, greatest z of what is to be seen [m], shape (4,)."""
    rims = [hoop.centre + side * hoop.diameter / 2 * hoop.across for hoop in scenario.hoops for side in (-1, 1)]
    points = np.array([scenario.start, scenario.goal, *rims])
    if ghost is not None:
        points = np.concatenate([points, ghost[:, 0:2]])
    low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
    # A floor or a ceiling near by is seen as a band.
    if scenario.floor is not None and scenario.floor > low[1] - MARGIN:
        low[1] = min(low[1], scenario.floor - MARGIN)
    if scenario.ceiling is not None and scenario.ceiling < high[1] + MARGIN:
        high[1] = max(high[1], scenario.ceiling + MARGIN)
    return np.concatenate([low, high])


def quadrotor(canvas: Canvas, centre: Array, theta: float, arm: float, body: Colour, rotor: Colour) -> None:
    """Draw the vehicle: an arm of half a width [px] with two rotors, a hub and its legs, tilted by theta."""
    right, up = np.array([np.cos(theta), np.sin(theta)]), np.array([np.sin(theta), -np.cos(theta)])

    def at(x: float, z: float) -> Array:
        return centre + arm * (x * right + z * up)

    for side in (-1, 1):
        canvas.line([at(0.2 * side, -0.05), at(0.34 * side, -0.34)], body, 0.08 * arm)
        canvas.line([at(0.9 * side, 0.0), at(0.9 * side, 0.3)], body, 0.12 * arm)
        turn = np.linspace(0, 2 * np.pi, 21)[:-1]
        blur = [at(0.9 * side + 0.56 * np.cos(t), 0.34 + 0.1 * np.sin(t)) for t in turn]
        canvas.area(blur, mix(rotor, PALE, 0.45) if rotor != body else rotor)
        canvas.line([at(0.9 * side - 0.52, 0.34), at(0.9 * side + 0.52, 0.34)], rotor, 0.07 * arm)
    canvas.line([at(-0.92, 0.0), at(0.92, 0.0)], body, 0.15 * arm)
    canvas.area([at(-0.3, -0.1), at(-0.2, 0.18), at(0.2, 0.18), at(0.3, -0.1), at(0.2, -0.18), at(-0.2, -0.18)], body)
