"""A fleet flown by compiled kernels; equal to `flatgym.envs.fleet.Fleet`, which says what it does."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

import numpy as np

from flatgym.envs import fleet
from flatgym.envs.fleet import Fleet, Mask, Record, ResetResult, StepResult, not_finite
from flatgym.kernels import layout
from flatgym.kernels.layout import BLOCK, ROWS, SETTINGS
from flatgym.kernels.step import advance
from flatgym.quadrotor import Array
from flatgym.scenarios.distributions import Distribution
from flatgym.scenarios.scenario import Scenario
from flatgym.task.observation import FAR, observation_names
from flatgym.task.scene import Integers

NUMBERS, NOTHING = len(fleet.ROWS), np.empty((0, 7))
PATIENCE = 2.0
"""Time after which a user is told what takes so long [s]."""


@contextmanager
def announce_compilation() -> Iterator[None]:
    """Say on standard error that the kernels are being compiled, should it take long: it is the first time here."""
    words = "flatgym: compiling the environment's kernels, once on this machine; it takes some 10 to 20 seconds"
    timer = threading.Timer(PATIENCE, print, [words], {"file": sys.stderr, "flush": True})
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


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
        self._apply()
        self._ended = np.zeros(n, dtype=np.int64)
        self._no_final = np.empty((0, self.columns), dtype=np.float32), np.empty((NUMBERS, 0))
        self._fixed = (
            self.flat,
            self.ids,
            self.hoops,
            self.pool,
            self.settings,
            self.numbers,
            self.pending,
            self._padded,
        )
        if not advance.signatures:
            with announce_compilation():
                self._advance(np.zeros((n, 7)))  # where nobody begins anything, but the kernels are compiled

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy: arrays are copied one by one, so what was part of another must become so again."""
        self.__dict__.update(state)
        self.actions = self._padded[: self.n]

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

    def _apply(self) -> None:
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
            "floor": -FAR if floor is None else floor,
            "ceiling": FAR if ceiling is None else ceiling,
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

    def reset(self, mask: Mask, state: Array | None = None, hoops_passed: Integers | None = None) -> ResetResult:
        """Begin episodes; see `Fleet.reset`."""
        given = np.full((self.n, 7), np.nan)
        given[:, 0] = mask
        if state is not None:
            given[:, 1:6] = state
        if hoops_passed is not None:
            given[:, 6] = hoops_passed
        begun = self._advance(given)
        return begun.observation, begun.record

    def step(self) -> StepResult:
        """Fly all one step; see `Fleet.step`."""
        return self._advance(NOTHING)

    def _advance(self, given: Array) -> StepResult:
        n, final = self.n, self._no_final
        observation = np.empty((n, self.columns), dtype=np.float32)
        record = Record(np.empty((NUMBERS, n)), np.empty((2, n), dtype=np.int64), np.empty((3, n), dtype=np.bool_))
        if self.same_step:
            final = np.empty_like(observation), np.empty_like(record.numbers)
        ended = advance(*self._fixed, given, observation, *record, self._ended, *final)
        if ended < 0:
            raise not_finite(self.actions)
        rows = self._ended[:ended].copy()
        if ended and self.same_step:
            return StepResult(observation, record, rows, *final)
        return StepResult(observation, record, rows)
