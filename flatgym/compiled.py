"""A fleet flown by compiled kernels; equal to `flatgym.fleet.Fleet`, which says what it does."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np

from flatgym.distributions import Distribution
from flatgym.fleet import RECORD, Begun, Fleet, Flown, Mask
from flatgym.kernels import layout, passes
from flatgym.kernels.layout import BLOCK, ROWS, SETTINGS
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
        # Whole blocks are flown, so that no vehicle's arithmetic depends on its place in a batch.
        self._padded = np.zeros((blocks * BLOCK, 2))
        self.actions = self._padded[:n]
        self.hoops = np.zeros((n, course.hoops_most, 5))
        self.pending = np.zeros((n, course.disturbances.action_delay + 1, 2))
        self.pool, self.numbers = np.zeros((0, 6)), np.zeros(8)
        if course.starts is not None:
            self.pool = np.column_stack([course.starts.state, course.starts.hoops_passed])
        if isinstance(course.problem, Distribution):
            self.numbers[:] = course.problem.numbers
            self._put(FLOOR_Z=-np.inf, CEILING_Z=np.inf)
        else:
            self._lay_out(course.problem)
        self.settings = np.zeros(1, dtype=SETTINGS)
        self._set()
        nobody = 1 if self.same_step else 0
        self._last = (n * nobody, self.columns), (len(RECORD), n * nobody)
        self._fixed = (self.flat, self.ids, self.hoops, self.pool, self.settings, self.numbers)

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
            table[:, int(getattr(layout, name)) // BLOCK] = value

    def _set(self) -> None:
        """Write the course to the record which the kernels read."""
        course = self.course
        values = asdict(course.quadrotor) | asdict(course.tolerance) | asdict(course.disturbances)
        values |= {
            "dt": course.dt,
            "max_steps": course.problem.max_steps,
            "last_step": course.last_step,
            "share": self.share,
            "shaped": course.shaped,
            "features": course.observation == "features",
            "drawn": isinstance(course.problem, Distribution),
            "disturbed": bool(course.disturbances.active),
            "same_step": self.same_step,
        }
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
        given = np.full((self.n, 7), np.nan)
        given[:, 0] = mask
        if state is not None:
            given[:, 1:6] = state
        if hoops_passed is not None:
            given[:, 6] = hoops_passed
        begun = np.empty((self.n, self.columns), dtype=np.float32), np.empty((len(RECORD), self.n))
        passes.reset(*self._fixed, given, *begun)
        return begun

    def step(self) -> Flown:
        """Fly all one step; see `Fleet.step`."""
        observation = np.empty((self.n, self.columns), dtype=np.float32)
        record = np.empty((len(RECORD), self.n))
        final_observation, final = np.empty(self._last[0], dtype=np.float32), np.empty(self._last[1])
        ended = passes.step(*self._fixed, self.pending, self._padded, observation, record, final_observation, final)
        if ended and self.same_step:
            return Flown(observation, record, final_observation, final)
        return Flown(observation, record)
