"""A fleet advanced by the compiled kernels of `flatgym.kernels`; equal to `NumpyFleet` up to 1e-9."""

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

NUMBERS, NO_RESET = len(fleet.ROWS), np.empty((0, 7))
GAPS = slice(6, 8)
"""Minimum and maximum width of a gap in `Distribution.numbers`."""
COMPILE_NOTICE_DELAY = 2.0
"""Time after which a compilation is announced [s]."""


@contextmanager
def announce_compilation() -> Iterator[None]:
    """Print a note to standard error if the kernels are still being compiled after COMPILE_NOTICE_DELAY."""
    text = "flatgym: compiling the environment's kernels, once on this machine; it takes some 10 to 20 seconds"
    timer = threading.Timer(COMPILE_NOTICE_DELAY, print, [text], {"file": sys.stderr, "flush": True})
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


class CompiledFleet(Fleet):
    """n vehicles advanced by `flatgym.kernels`; see `Fleet`. A step allocates only the arrays it returns."""

    def _allocate(self) -> None:
        config, n = self.config, self.n
        self.columns = len(observation_names(config.observation))
        blocks = -(-n // BLOCK)
        self.flat = np.zeros(blocks * ROWS * BLOCK)
        # Padded to whole blocks, so that a vehicle's rounding does not depend on its index in the batch.
        self._padded = np.zeros((blocks * BLOCK, 2))
        self.actions = self._padded[:n]
        self.hoops = np.zeros((n, config.hoops_most, 5))
        self.pending = np.zeros((n, config.disturbances.action_delay + 1, 2))
        self.distribution = np.zeros(0)
        if isinstance(config.problem, Distribution):
            self.distribution = np.array(config.problem.numbers)
            self.distribution[GAPS] += 2 * config.margin
        else:
            self._write_scene(config.problem)
        self.settings = np.zeros(1, dtype=SETTINGS)
        self._ended = np.zeros(n, dtype=np.int64)
        self._no_final = np.empty((0, self.columns), dtype=np.float32), np.empty((NUMBERS, 0))
        self._apply_config()
        if not advance.signatures:
            with announce_compilation():
                self._advance(np.zeros((n, 7)))  # compiles the kernels and resets no vehicle

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy: `actions` is a view of the padded array, which copying arrays one by one would separate."""
        self.__dict__.update(state)
        self.actions = self._padded[: self.n]

    def _write_scene(self, scenario: Scenario) -> None:
        """Write goal, bounds and hoops of a scenario to the rows of all vehicles."""
        low_x, low_z, high_x, high_z = scenario.bounds
        self._write_rows(
            GOAL_X=scenario.goal[0],
            GOAL_Z=scenario.goal[1],
            LOW_X=low_x,
            LOW_Z=low_z,
            HIGH_X=high_x,
            HIGH_Z=high_z,
            COUNT=float(len(scenario.hoops)),
        )
        for j, hoop in enumerate(scenario.hoops):
            self.hoops[:, j] = *hoop.centre, *hoop.direction, hoop.diameter + 2 * self.config.margin

    def _write_rows(self, **rows: float) -> None:
        table = self.flat.reshape(-1, ROWS, BLOCK)
        for name, value in rows.items():
            table[:, int(getattr(layout, name)) // BLOCK] = value

    def _apply_config(self) -> None:
        """Write the configuration to the record and the pool that the kernels read."""
        config = self.config
        values = asdict(config.quadrotor) | asdict(config.tolerance) | asdict(config.disturbances)
        scenario = config.problem if isinstance(config.problem, Scenario) else None
        start = (0.0, 0.0) if scenario is None else scenario.start
        floor, ceiling = (None, None) if scenario is None else (scenario.floor, scenario.ceiling)
        values |= {
            "dt": config.dt,
            "start_x": start[0],
            "start_z": start[1],
            "floor": -FAR if floor is None else floor - config.margin,
            "ceiling": FAR if ceiling is None else ceiling + config.margin,
            "max_steps": config.problem.max_steps,
            "last_step": config.last_step,
            "share": self.share,
            "shaped": config.shaped,
            "features": config.observation == "features",
            "drawn": isinstance(config.problem, Distribution),
            "disturbed": bool(config.disturbances.active),
            "same_step": self.same_step,
        }
        for name, value in values.items():
            self.settings[name] = value
        self.pool = np.zeros((0, 6))
        if config.starts is not None:
            pool = np.column_stack([config.starts.state, config.starts.hoops_passed])
            self.pool = np.ascontiguousarray(pool)  # another memory layout would compile the kernels again

    def reset(self, mask: Mask, state: Array | None = None, hoops_passed: Integers | None = None) -> ResetResult:
        """Start episodes; see `Fleet.reset`."""
        given = np.full((self.n, 7), np.nan)
        given[:, 0] = mask
        if state is not None:
            given[:, 1:6] = state
        if hoops_passed is not None:
            given[:, 6] = hoops_passed
        result = self._advance(given)
        return result.observation, result.record

    def step(self) -> StepResult:
        """Advance all vehicles by one step; see `Fleet.step`."""
        return self._advance(NO_RESET)

    def _advance(self, given: Array) -> StepResult:
        """Call the kernel: a step if `given` has no rows, else a reset as `kernels.step.start_requested` describes."""
        n, final = self.n, self._no_final
        observation = np.empty((n, self.columns), dtype=np.float32)
        record = Record(np.empty((NUMBERS, n)), np.empty((2, n), dtype=np.int64), np.empty((3, n), dtype=np.bool_))
        if self.same_step:
            final = np.empty_like(observation), np.empty_like(record.numbers)
        ended = advance(
            self.flat,
            self.ids,
            self.hoops,
            self.pool,
            self.settings,
            self.distribution,
            self.pending,
            self._padded,
            given,
            observation,
            *record,
            self._ended,
            *final,
        )
        if ended < 0:
            raise not_finite(self.actions)
        rows = self._ended[:ended].copy()
        if ended and self.same_step:
            return StepResult(observation, record, rows, *final)
        return StepResult(observation, record, rows)
