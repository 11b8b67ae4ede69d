"""A fleet flown by compiled kernels; equal to `flatgym.fleet.Fleet`, which says what it does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from flatgym import kernels
from flatgym.distributions import Distribution
from flatgym.fleet import Begun, Fleet, Flown, Mask, Told
from flatgym.kernels import BLOCK, ROWS, SETTINGS
from flatgym.quadrotor import Array
from flatgym.scenario import Scenario, Tolerance
from flatgym.scene import Integers
from flatgym.task import observation_names


class CompiledFleet(Fleet):
    """n flights of a course through `flatgym.kernels`; nothing is allocated in a step but what is returned."""

    def _prepare(self) -> None:
        course, n = self.course, self.n
        self.columns = len(observation_names(course.observation))
        blocks = -(-n // BLOCK)
        self.flat = np.zeros(blocks * ROWS * BLOCK)
        self.hoops = np.zeros((n, course.hoops_most, 5))
        self.pending = np.zeros((n, course.disturbances.action_delay + 1, 2))
        if isinstance(course.problem, Scenario):
            self._lay_out(course.problem)
        else:
            self._put(FLOOR_Z=-np.inf, CEILING_Z=np.inf)
        starts = course.starts
        pool = (np.zeros((0, 5)), np.zeros(0, dtype=np.int64))
        if starts is not None:
            pool = (starts.state, starts.hoops_passed)
        numbers = course.problem.numbers if isinstance(course.problem, Distribution) else (0.0,) * 8
        self.settings = np.zeros(1, dtype=SETTINGS)
        self._set()
        self.world = (self.settings, numbers, *pool)

    def _lay_out(self, scenario: Scenario) -> None:
        low_x, low_z, high_x, high_z = scenario.bounds
        self._put(
            START_X=scenario.start[0],
            START_Z=scenario.start[1],
            GOAL_X=scenario.goal[0],
            GOAL_Z=scenario.goal[1],
            FLOOR_Z=-np.inf if scenario.floor is None else scenario.floor,
            CEILING_Z=np.inf if scenario.ceiling is None else scenario.ceiling,
            LOW_X=low_x,
            LOW_Z=low_z,
            HIGH_X=high_x,
            HIGH_Z=high_z,
            COUNT=float(len(scenario.hoops)),
        )
        for j, hoop in enumerate(scenario.hoops):
            self.hoops[:, j] = *hoop.centre, *hoop.direction, hoop.diameter

    def _put(self, **rows: float) -> None:
        table = self.flat.reshape(-1, ROWS, BLOCK)
        for name, value in rows.items():
            table[:, int(getattr(kernels, name)) // BLOCK] = value

    def _set(self) -> None:
        course, quadrotor, tolerance = self.course, self.course.quadrotor, self.course.tolerance
        values: dict[str, Any] = {
            "dt": course.dt,
            "thrust_min": quadrotor.thrust_min,
            "thrust_max": quadrotor.thrust_max,
            "rate_max": quadrotor.rate_max,
            "gravity": quadrotor.gravity,
            "radius": quadrotor.radius,
            "position": tolerance.position,
            "speed": tolerance.speed,
            "angle": tolerance.angle,
            "max_steps": course.max_steps,
            "share": self.share,
            "shaped": course.shaped,
            "features": course.observation == "features",
            "drawn": isinstance(course.problem, Distribution),
            "disturbed": bool(course.disturbances.active),
            "same_step": self.same_step,
        }
        for name in ("wind", "thrust_gain", "mass", "action_delay", "sensor_noise"):
            values[name] = getattr(course.disturbances, name)
        for name, value in values.items():
            self.settings[name] = value

    def set_tolerance(self, tolerance: Tolerance) -> None:
        """Let something else count as arrived from the next step on."""
        self.course = replace(self.course, problem=replace(self.course.problem, tolerance=tolerance))
        self._set()

    def set_share(self, share: float) -> None:
        """Let another share of the episodes begin in the pool of starts."""
        self.share = share
        self._set()

    def reset(self, mask: Mask, state: Array | None = None, hoops_passed: Integers | None = None) -> Begun:
        """Begin episodes; see `Fleet.reset`."""
        given = np.full((self.n, 6), np.nan)
        if state is not None:
            given[:, 0:5] = state
        if hoops_passed is not None:
            given[:, 5] = hoops_passed
        begun = np.empty((self.n, self.columns), dtype=np.float32), _blank(self.n)
        kernels.reset(self.flat, self.seeds, self.episodes, self.hoops, self.world, mask, given, *begun)
        return begun

    def step(self, actions: Array) -> Flown:
        """Fly all one step; see `Fleet.step`."""
        n = self.n
        flown = Flown(
            np.empty((n, self.columns), dtype=np.float32),
            np.empty(n),
            np.empty(n, dtype=np.bool_),
            np.empty(n, dtype=np.bool_),
            _blank(n),
            np.empty((n if self.same_step else 0, self.columns), dtype=np.float32),
            _blank(n if self.same_step else 0),
        )
        ended = kernels.step(
            self.flat, self.seeds, self.episodes, self.hoops, self.world, self.pending, actions, *flown
        )
        return flown if ended and self.same_step else flown._replace(final_observation=None, final=None)


def _blank(n: int) -> Told:
    return Told(np.empty((n, 5)), np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int8))
