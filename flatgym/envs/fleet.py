"""A fleet: n vehicles in one environment configuration, each with its own sequence of episodes.

`Fleet` is the interface that the Gymnasium environments use. `NumpyFleet` implements it with the functions of
`flatgym.task`, `CompiledFleet` with the kernels of `flatgym.kernels`. `flatgym.envs.fleet_selection` chooses.

A vehicle has a seed and an episode number. Everything random in an episode is a function of these two
(`flatgym.scenarios.counter_rng`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatgym.envs.config import EnvConfig, Starts
from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario, Tolerance
from flatgym.task.scene import FLYING, GOAL, TIME_LIMIT, Integers

Mask = NDArray[np.bool_]
Seeds = NDArray[np.uint64]

ROWS = ("x", "z", "vx", "vz", "theta", "steps", "hoops_passed", "outcome", "reward", "end", "time")
"""Rows of `Record.numbers`; `end` is the outcome if the step ended the episode, else 0."""
STEPS, HOOPS_PASSED, OUTCOME, REWARD, END, TIME = range(5, 11)


class Record(NamedTuple):
    """States of n episodes after a reset or step, with the results of the step.

    Attributes:
        numbers: rows as in ROWS, shape (11, n).
        counts: steps and hoops passed as integers, shape (2, n), int64.
        flags: terminated, truncated, and whether the vehicle is at its goal, shape (3, n).
    """

    numbers: Array
    counts: Integers
    flags: Mask

    @classmethod
    def of(cls, numbers: Array) -> Record:
        """Return the record with these numbers, shape (11, n)."""
        end, truncated = numbers[END] != FLYING, numbers[END] == TIME_LIMIT
        flags = np.stack([end & ~truncated, truncated, numbers[OUTCOME] == GOAL])
        return cls(numbers, numbers[STEPS : HOOPS_PASSED + 1].astype(np.int64), flags)


class StepResult(NamedTuple):
    """Result of a step.

    Attributes:
        observation: shape (n, components), float32.
        record: episode states; with `same_step`, an episode that ended is already replaced by the next one.
        ended: indices of the vehicles whose episode ended.
        final_observation, final: observations and numbers before that replacement, valid for `ended` only; None if no
            episode ended or without `same_step`.
    """

    observation: NDArray[np.float32]
    record: Record
    ended: Integers
    final_observation: NDArray[np.float32] | None = None
    final: Array | None = None


ResetResult = tuple[NDArray[np.float32], Record]
"""Observations, shape (n, components), and the record of all vehicles."""


class Fleet(ABC):
    """n vehicles in one environment configuration.

    Args:
        config: scenario or distribution, reward, observation, disturbances, pool of starts.
        n: number of vehicles.
        same_step: whether the next episode starts within the step that ends one. Otherwise the following step starts
            it and ignores its action.

    Attributes:
        actions: actions of the next step, shape (n, 2), written by the caller; clipped to the box.
        share: probability that an episode starts in the pool of starts.
        ids: seeds and episode numbers, shape (2, n).
    """

    actions: Array

    def __init__(self, config: EnvConfig, n: int, same_step: bool = False) -> None:
        self.config, self.n, self.same_step = config, n, same_step
        self.share = config.starts.share if config.starts else 0.0
        self.ids = np.zeros((2, n), dtype=np.uint64)
        self._allocate()

    @abstractmethod
    def _allocate(self) -> None:
        """Allocate the arrays of n vehicles, `actions` among them."""

    @abstractmethod
    def _apply_config(self) -> None:
        """Apply a changed `config` or `share`."""

    @abstractmethod
    def reset(self, mask: Mask, state: Array | None = None, hoops_passed: Integers | None = None) -> ResetResult:
        """Start the episodes `self.episodes` of the vehicles under `mask`.

        Args:
            mask: shape (n,).
            state: start states [x, z, vx, vz, theta], shape (n, 5), or None for the episodes' own.
            hoops_passed: hoops that count as passed, shape (n,), or None.
        """

    @abstractmethod
    def step(self) -> StepResult:
        """Advance all vehicles by one step under `actions`.

        Raises:
            ValueError: for actions that are not finite; no vehicle has moved then.
        """

    @property
    def seeds(self) -> Seeds:
        """Seeds of the vehicles, shape (n,)."""
        return self.ids[0]

    @property
    def episodes(self) -> Seeds:
        """Numbers of the current episodes, shape (n,)."""
        return self.ids[1]

    def controls(self) -> Array:
        """Return the commanded controls [thrust, rate] of `actions`, clipped to the box, shape (n, 2)."""
        return self.config.quadrotor.control(np.clip(self.actions, -1.0, 1.0))

    def set_tolerance(self, tolerance: Tolerance) -> None:
        """Replace the goal tolerance from the next step on."""
        if not isinstance(tolerance, Tolerance):
            raise ValueError(f"tolerance must be a Tolerance, got {tolerance!r}")
        self.config = replace(self.config, problem=replace(self.config.problem, tolerance=tolerance))
        self._apply_config()

    def set_share(self, share: float) -> None:
        """Replace the probability that an episode starts in the pool of starts."""
        if not 0 <= share <= 1:
            raise ValueError(f"share must lie in [0, 1], got {share}")
        self.share = share
        self._apply_config()

    def set_starts(self, starts: Starts) -> None:
        """Replace the pool of starts from the next episode on; `share` stays as it is.

        Raises:
            ValueError: for a pool that does not fit the scenario.
        """
        self.config = replace(self.config, starts=starts)
        self._apply_config()

    def reseed(self, mask: Mask, seeds: Seeds | None) -> None:
        """Select the next episodes under `mask`: the first of new seeds (n,), or with None the next of the old."""
        if seeds is None:
            self.ids[1, mask] += np.uint64(1)
        else:
            self.ids[0, mask], self.ids[1, mask] = seeds[mask], np.uint64(0)

    def hoop_counts(self) -> Integers:
        """Return the number of hoops of the episodes `self.episodes`, shape (n,), also before they start."""
        problem = self.config.problem
        if isinstance(problem, Scenario):
            return np.full(self.n, len(problem.hoops))
        return problem.draw(self.seeds, self.episodes)[:, 2].astype(np.int64)


def not_finite(actions: Array) -> ValueError:
    """Return the error for actions that are not finite, with up to five values and their indices."""
    wrong = ~np.isfinite(actions)
    where = [tuple(map(int, index)) for index in np.argwhere(wrong)[:5]]
    return ValueError(f"actions must be finite, got {actions[wrong][:5]} at indices {where}")
