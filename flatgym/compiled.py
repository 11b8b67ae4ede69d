"""A fleet flown by compiled kernels; equal to `flatgym.fleet.Fleet`, which says what it does."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np

from flatgym import fleet
from flatgym.distributions import Distribution
from flatgym.fleet import Begun, Fleet, Flown, Mask, Record, not_finite
from flatgym.kernels import layout, passes
from flatgym.kernels.layout import BLOCK, ROWS, SETTINGS
from flatgym.quadrotor import Array
from flatgym.scenario import Scenario, Tolerance
from flatgym.scene import Integers
from flatgym.task import observation_names

NUMBERS = len(fleet.ROWS)


class CompiledFleet(Fleet):
    """n flights of a course through `flatgym.kernels`; nothing is allocated in a step but what is returned."""

    def _prepare(self) -> None:
        course, n = self.course, self.n
        self.columns = len(observation_names(course.observation))
        blocks = -(-n // BLOCK)
        self.flat = np.zeros(blocks * ROWS * BLOCK)
        # Whole groups are flown, so that no vehicle's arithmetic depends on its place in a batch.
        self._padded = np.zeros((blocks * BLOCK, 2))
        self.actions = self._padded[:n]
        self.hoops = np.zeros((n, course.hoops_most, 5))
        self.pending = np.zeros((n, course.disturbances.action_delay + 1, 2))
        self.pool, self.numbers = np.zeros((0, 6)), np.zeros(8)
        if course.starts is not None:
            self.pool = np.column_stack([course.starts.state, course.starts.hoops_passed])
        if isinstance(course.problem, Distribution):
            self.numbers[:] = course.problem.numbers
        else:
            self._lay_out(course.problem)
        self.settings = np.zeros(1, dtype=SETTINGS)
        self._set()
        self._ended = np.zeros(n, dtype=np.int64)
        self._no_final = np.empty((0, self.columns), dtype=np.float32), np.empty((NUMBERS, 0))
        self._fixed = (self.flat, self.ids, self.hoops, self.pool, self.settings, self.numbers)

    def _lay_out(self, scenario: Scenario) -> None:
        low_x, low_z, high_x, high_z = scenario.bounds
        self._put(
            GOAL_X=scenario.goal[0],
            GOAL_Z=scenario.goal[1],
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
        scenario = course.problem if isinstance(course.problem, Scenario) else None
        start = (0.0, 0.0) if scenario is None else scenario.start
        floor, ceiling = (None, None) if scenario is None else (scenario.floor, scenario.ceiling)
        values |= {
            "dt": course.dt,
            "start_x": start[0],
            "start_z": start[1],
            "floor": -np.inf if floor is None else floor,
            "ceiling": np.inf if ceiling is None else ceiling,
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
        observation, record = np.empty((self.n, self.columns), dtype=np.float32), self._blank()
        passes.reset(*self._fixed, given, observation, *record)
        return observation, record

    def step(self) -> Flown:
        """Fly all one step; see `Fleet.step`."""
        observation, record, final = np.empty((self.n, self.columns), dtype=np.float32), self._blank(), self._no_final
        if self.same_step:
            final = np.empty_like(observation), np.empty_like(record.numbers)
        ended = passes.step(*self._fixed, self.pending, self._padded, observation, *record, self._ended, *final)
        if ended < 0:
            raise not_finite(self.actions)
        rows = self._ended[:ended].copy()
        return (
            Flown(observation, record, rows, *final) if ended and self.same_step else Flown(observation, record, rows)
        )

    def _blank(self) -> Record:
        n = self.n
        return Record(np.empty((NUMBERS, n)), np.empty((2, n), dtype=np.int64), np.empty((3, n), dtype=np.bool_))
