"""Pictures of an episode: the vehicle, its path coloured by thrust, and a ghost for comparison.

The camera shows start, goal, hoops, ghost, and all states of the episode. A picture is a function of the episode alone.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import groupby

import numpy as np

from flatgym.quadrotor import Array
from flatgym.rendering import dashboard
from flatgym.rendering.backdrop import Backdrop
from flatgym.rendering.canvas import Camera, Canvas, Colour, Pixels, mix, ramp
from flatgym.rendering.instant import Instant, between, box_of_interest
from flatgym.rendering.palette import GHOST, INK, PALE, PAPER, ROTOR
from flatgym.scenarios.scenario import Scenario

ROOM = 0.5
"""Margin around the states of the vehicle [m]."""
PADDING = 36.0
"""Padding of the view, for labels [px of a picture of 960 x 720]."""
ARM = 0.2
"""Half the width of the drawn quadrotor [m]; limited to a visible range in pixels."""


class Picture:
    """Pictures of episodes of one scenario, all of one size.

    Args:
        scenario: the scenario.
        size: width and height [px].
        k_star: K*, or None.
        ghost: states of another trajectory, shape (n, 5), or None.
    """

    def __init__(self, scenario: Scenario, size: tuple[int, int], k_star: int | None, ghost: Array | None) -> None:
        self.scenario, self.k_star, self.ghost = scenario, k_star, ghost
        self.unit = min(size[0] / 960, size[1] / 720)
        """Scale of the picture relative to 960 x 720 pixels."""
        self.view = (0.0, dashboard.HEADER * self.unit, float(size[0]), size[1] - dashboard.HEIGHT * self.unit)
        self.box = box_of_interest(scenario, ghost)
        self.canvas, self.backdrop = Canvas(size, PAPER), Backdrop(scenario, self.unit)
        self._behind = Canvas(size, PAPER)
        self._drawn: tuple[Camera, int, bool] | None = None

    def camera(self, states: Array) -> Camera:
        """Return the camera that shows the region of interest and all states (n, 5)."""
        low, high = states[:, 0:2].min(axis=0) - ROOM, states[:, 0:2].max(axis=0) + ROOM
        box = np.concatenate([np.minimum(self.box[0:2], low), np.maximum(self.box[2:4], high)])
        camera = Camera.fit(box, self.view, padding=PADDING * self.unit, scale_most=150 * self.unit)
        return self._on_the_ground(camera, box)

    def _on_the_ground(self, camera: Camera, box: Array) -> Camera:
        """Return the camera shifted so that spare height is not spent below a floor or above a ceiling."""
        (x, _), floor, ceiling = camera.look_at, self.scenario.floor, self.scenario.ceiling
        half = (self.view[3] / 2 - PADDING * self.unit) / camera.scale
        seen = [limit is not None and box[1] < limit < box[3] for limit in (floor, ceiling)]
        if seen == [True, False]:
            return replace(camera, look_at=(x, float(box[1]) + half))
        if seen == [False, True]:
            return replace(camera, look_at=(x, float(box[3]) - half))
        return camera

    def draw(self, instant: Instant, with_ghost: bool = True) -> Canvas:
        """Return the canvas with the episode at an instant; the next call overwrites it."""
        camera, canvas, ghost = self.camera(instant.states), self.canvas, self.ghost if with_ghost else None
        wanted = camera, instant.hoops_passed, ghost is not None
        if self._drawn != wanted:
            self.backdrop.draw(self._behind, camera, instant.hoops_passed, ghost)
            self._drawn = wanted
        canvas.start_from(self._behind)
        canvas.clip(self.view)
        self._trail(camera, instant)
        if ghost is not None:
            self._ghost(camera, between(ghost, max(instant.steps - 1 + instant.part, 0.0)))
        self._vehicle(camera, instant)
        self.backdrop.hoops(canvas, camera, instant.hoops_passed, near=True)
        canvas.clip(None)
        reading = dashboard.Reading(self.scenario, instant.steps, instant.hoops_passed, instant.outcome, self.k_star)
        dashboard.header(canvas, self.unit, reading)
        return canvas

    def pixels(self, instant: Instant, with_ghost: bool = True) -> Pixels:
        """Return the picture as RGB values, shape (height, width, 3)."""
        return self.draw(instant, with_ghost).pixels()

    def _thrust_colour(self, thrust: float) -> Colour:
        quadrotor = self.scenario.quadrotor
        return ramp(float((thrust - quadrotor.thrust_min) / (quadrotor.thrust_max - quadrotor.thrust_min)))

    def _trail(self, camera: Camera, instant: Instant) -> None:
        places, colours = camera(instant.states[:, 0:2]), [self._thrust_colour(thrust) for thrust in instant.thrusts]
        for colour, group in groupby(range(instant.steps), colours.__getitem__):
            steps = list(group)
            self.canvas.line(places[steps[0] : steps[-1] + 2], colour, 4.5 * self.unit, smooth=True)

    def _arm(self, camera: Camera) -> float:
        return float(np.clip(ARM * camera.scale, 24 * self.unit, 34 * self.unit))

    def _ghost(self, camera: Camera, state: Array) -> None:
        arm = self._arm(camera)
        side = math.ceil(4 * arm)
        sheet = Canvas((side, side))
        quadrotor(sheet, np.full(2, side / 2), state[4], arm, GHOST, GHOST)
        self.canvas.put(sheet, camera(state[0:2]) - side / 2, opacity=0.5)

    def _vehicle(self, camera: Camera, instant: Instant) -> None:
        state, arm = instant.states[-1], self._arm(camera)
        centre = camera(state[0:2])
        if instant.steps and instant.outcome == "flying":
            self._thrust(centre, state[4], float(instant.thrusts[-1]), arm)
        quadrotor(self.canvas, centre, state[4], arm, INK, ROTOR)

    def _thrust(self, centre: Array, theta: float, thrust: float, arm: float) -> None:
        up = np.array([np.sin(theta), -np.cos(theta)])
        tip = centre + (0.5 + 2.1 * thrust / self.scenario.quadrotor.thrust_max) * arm * up
        self.canvas.line([centre, tip - 8 * self.unit * up], PAPER, 5.5 * self.unit)
        self.canvas.arrow(centre, tip, self._thrust_colour(thrust), 3.5 * self.unit)


def quadrotor(canvas: Canvas, centre: Array, theta: float, arm: float, body: Colour, rotor: Colour) -> None:
    """Draw the vehicle tilted by theta: an arm of half width `arm` [px], two rotors, a hub and legs."""
    right, up = np.array([np.cos(theta), np.sin(theta)]), np.array([np.sin(theta), -np.cos(theta)])

    def at(*points: tuple[float, float]) -> Array:
        x, z = np.array(points).T
        return centre + arm * (np.outer(x, right) + np.outer(z, up))

    turn = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    for side in (-0.9, 0.9):
        canvas.line(at((0.2 * side, -0.05), (0.36 * side, -0.34)), body, 0.08 * arm)
        canvas.line(at((side, 0.0), (side, 0.3)), body, 0.12 * arm)
        blur = at(*zip(side + 0.56 * np.cos(turn), 0.34 + 0.1 * np.sin(turn), strict=True))
        canvas.area(blur, rotor if rotor == body else mix(rotor, PALE, 0.45))
        canvas.line(at((side - 0.52, 0.34), (side + 0.52, 0.34)), rotor, 0.07 * arm)
    canvas.line(at((-0.92, 0.0), (0.92, 0.0)), body, 0.15 * arm)
    canvas.area(at((-0.3, -0.1), (-0.2, 0.18), (0.2, 0.18), (0.3, -0.1), (0.2, -0.18), (-0.2, -0.18)), body)
