"""Many flights of a course, with their episodes: the verbs of `flatgym.task`, and what begins anew when.

`Fleet` is written with NumPy; `flatgym.envs.compiled_fleet.CompiledFleet` is the same through compiled kernels, which
the environments take where numba is installed. Both, scalar and batched, are thin shells around one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatgym import task
from flatgym.envs.config import EnvConfig
from flatgym.quadrotor import Array
from flatgym.scenarios.counter_rng import START, uniform
from flatgym.scenarios.distributions import PER_HOOP, PLACED, Distribution
from flatgym.scenarios.scenario import BOUNDS_MARGIN, Scenario, Tolerance
from flatgym.task.scene import FLYING, GOAL, TIME_LIMIT, Integers, Scene

Mask = NDArray[np.bool_]
Seeds = NDArray[np.uint64]


ROWS = ("x", "z", "vx", "vz", "theta", "steps", "hoops_passed", "outcome", "reward", "end", "time")
"""Rows of a record's numbers; `end` is the outcome if the step ended the flight, else 0."""
STEPS, HOOPS_PASSED, OUTCOME, REWARD, END, TIME = range(5, 11)


class Record(NamedTuple):
    """How n flights stand, and what the step gave them.

    Attributes:
        numbers: rows as in ROWS, shape (11, n).
        counts: steps and hoops passed once more, shape (2, n), int64.
        flags: whether the step ended the flight for good, whether only the clock did, whether the vehicle is at its
            goal, shape (3, n).
    """

    numbers: Array
    counts: Integers
    flags: Mask

    @classmethod
    def of(cls, numbers: Array) -> Record:
        """Return the record with these numbers."""
        end, truncated = numbers[END] != FLYING, numbers[END] == TIME_LIMIT
        flags = np.stack([end & ~truncated, truncated, numbers[OUTCOME] == GOAL])
        return cls(numbers, numbers[STEPS : HOOPS_PASSED + 1].astype(np.int64), flags)


class StepResult(NamedTuple):
    """What a step gave.

    Attributes:
        observation: shape (n, components), float32.
        record: how the flights stand; who ended has begun anew in it, if that happens within the step.
        ended: numbers of the flights that ended.
        final_observation, final: observations and numbers before that, right for the flights that ended only; None when
            none did, or when none begins anew within the step.
    """

    observation: NDArray[np.float32]
    record: Record
    ended: Integers
    final_observation: NDArray[np.float32] | None = None
    final: Array | None = None


ResetResult = tuple[NDArray[np.float32], Record]


class Fleet:
    """n flights of a course.

    Args:
        course: what is flown.
        n: number of flights.
        same_step: whether a flight that ends begins anew within the step; otherwise the next step does it, ignoring
            its action.

    Attributes:
        actions: actions for the next step, shape (n, 2); they are clipped to the box.
    """

    def __init__(self, course: EnvConfig, n: int, same_step: bool = False) -> None:
        self.course, self.n, self.same_step = course, n, same_step
        self.share = course.starts.share if course.starts else 0.0
        self.ids = np.zeros((2, n), dtype=np.uint64)
        self.actions = np.zeros((n, 2))
        self._prepare()

    @property
    def seeds(self) -> Seeds:
        """The seeds of the flights, shape (n,)."""
        return self.ids[0]

    @property
    def episodes(self) -> Seeds:
        """The numbers of their present episodes, shape (n,)."""
        return self.ids[1]

    def _prepare(self) -> None:
        self.scene = scene_of(self.course, self.seeds, self.episodes)
        self.situation = task.initial(self.scene)
        self.waits = np.zeros(self.n, dtype=bool)
        self.pending = np.zeros((self.course.disturbances.action_delay + 1, self.n, 2))

    def set_tolerance(self, tolerance: Tolerance) -> None:
        """Let something else count as arrived from the next step on."""
        if not isinstance(tolerance, Tolerance):
            raise ValueError(f"tolerance must be a Tolerance, got {tolerance!r}")
        self.course = replace(self.course, problem=replace(self.course.problem, tolerance=tolerance))
        self._apply()

    def set_share(self, share: float) -> None:
        """Let another share of the episodes begin in the pool of starts."""
        if not 0 <= share <= 1:
            raise ValueError(f"share must lie in [0, 1], got {share}")
        self.share = share
        self._apply()

    def _apply(self) -> None:
        """Let what has changed in the course take effect."""
        self.scene = replace(self.scene, tolerance=self.course.tolerance)

    def reseed(self, mask: Mask, seeds: Seeds | None) -> None:
        """Number the episodes that begin next under `mask`: the first of new seeds (n,), or the next of the old."""
        if seeds is None:
            self.ids[1, mask] += np.uint64(1)
        else:
            self.ids[0, mask], self.ids[1, mask] = seeds[mask], np.uint64(0)

    def hoop_counts(self) -> Integers:
        """Return the number of hoops of the present episodes, shape (n,), before they have begun."""
        problem = self.course.problem
        if isinstance(problem, Scenario):
            return np.full(self.n, len(problem.hoops))
        return problem.draw(self.seeds, self.episodes)[:, 2].astype(np.int64)

    def reset(self, mask: Mask, state: Array | None = None, hoops_passed: Integers | None = None) -> ResetResult:
        """Begin the episodes `self.episodes` of the flights under `mask`, at given states or at their own starts.

        Args:
            mask: shape (n,).
            state: [x, z, vx, vz, theta], shape (n, 5), or None.
            hoops_passed: hoops that count as passed already, shape (n,), or None.

        Returns:
            Observations, shape (n, components), and the record of all flights.
        """
        self._start(np.flatnonzero(mask))
        if state is not None:
            self.situation = self.situation.put(mask, replace(self.situation, state=state))
        if hoops_passed is not None:
            self.situation = self.situation.put(mask, replace(self.situation, hoops_passed=hoops_passed))
        self.waits = self.waits & ~mask
        return self._observe(), Record.of(self._numbers(np.zeros(self.n), np.zeros(self.n)))

    def _observe(self) -> NDArray[np.float32]:
        seen, disturbances = self.situation, self.course.disturbances
        if disturbances.sensor_noise:
            steps = seen.steps.astype(np.uint64)
            seen = replace(seen, state=seen.state + disturbances.noise(self.seeds, self.episodes, steps))
        return task.observe(self.scene, seen, self.course.observation)

    def step(self) -> StepResult:
        """Fly all one step under `actions`; a ValueError names those that are not finite, and nobody has flown then."""
        if not np.isfinite(self.actions).all():
            raise not_finite(self.actions)
        control = self._late(self.course.quadrotor.control(np.clip(self.actions, -1.0, 1.0)))
        before, idle = self.situation, self.waits
        after = self.situation = task.advance(self.scene, before, control)
        reward = np.where(idle, 0.0, task.reward(self.scene, before, after, self.course.shaped))
        end = np.where(idle, FLYING, after.outcome)
        if idle.any():
            self._begin_next(idle)
        self.waits, final_observation, final = end != FLYING, None, None
        if self.same_step and self.waits.any():
            final_observation, final = self._observe(), self._numbers(reward, end)
            self._begin_next(self.waits)
            self.waits = np.zeros(self.n, dtype=bool)
        record, ended = Record.of(self._numbers(reward, end)), np.flatnonzero(end)
        return StepResult(self._observe(), record, ended, final_observation, final)

    def _late(self, control: Array) -> Array:
        """Put controls into their queues and return those whose time has come; before the first, hover."""
        slots = len(self.pending)
        if slots == 1:
            return control
        rows, steps, delay = np.arange(self.n), self.situation.steps, self.scene.delay
        self.pending[steps % slots, rows] = control
        due = self.pending[(steps - delay) % slots, rows]
        hover = np.array([self.course.quadrotor.gravity, 0.0])
        return np.where((delay > steps)[:, None], hover, due)

    def _begin_next(self, mask: Mask) -> None:
        self.ids[1, mask] += np.uint64(1)
        self._start(np.flatnonzero(mask))

    def _start(self, rows: NDArray[np.intp]) -> None:
        seeds, episodes = self.seeds[rows], self.episodes[rows]
        if isinstance(self.course.problem, Distribution) or self.course.disturbances.active:
            self.scene = self.scene.put(rows, scene_of(self.course, seeds, episodes))
        fresh, mask = task.initial(self.scene), np.zeros(self.n, dtype=bool)
        mask[rows] = True
        self.situation = self.situation.put(mask, fresh)
        if (pool := self.course.starts) is not None:
            drawn = uniform(seeds, episodes, np.uint64(START)) < self.share
            row = (uniform(seeds, episodes, np.uint64(START + 1)) * len(pool.state)).astype(np.int64)[drawn]
            self.situation.state[rows[drawn]] = pool.state[row]
            self.situation.hoops_passed[rows[drawn]] = pool.hoops_passed[row]

    def _numbers(self, reward: Array, end: NDArray[Any]) -> Array:
        now = self.situation
        time = now.steps * self.course.dt
        return np.vstack([now.state.T, now.steps, now.hoops_passed, now.outcome, reward, end, time])


def not_finite(actions: Array) -> ValueError:
    """Return the error that names the actions which are not finite."""
    wrong = ~np.isfinite(actions)
    where = [tuple(map(int, index)) for index in np.argwhere(wrong)[:5]]
    return ValueError(f"actions must be finite, got {actions[wrong][:5]} at indices {where}")


def scene_of(course: EnvConfig, seeds: Seeds, episodes: Seeds) -> Scene:
    """Return the scene of episodes of a course, shapes (n,): scenarios drawn if they are, disturbances too."""
    problem, n = course.problem, len(seeds)
    if isinstance(problem, Distribution):
        scene = drawn_scene(problem, seeds, episodes)
    else:
        scene = Scene.of([problem]).repeat(n)
    factor, wind, delay = course.disturbances.draw(seeds, episodes)
    return replace(scene, last_step=np.full(n, course.last_step), thrust_factor=factor, wind=wind, delay=delay)


def drawn_scene(problem: Distribution, seeds: Seeds, episodes: Seeds) -> Scene:
    """Return the scene of drawn scenarios."""
    rows, n, most = problem.draw(seeds, episodes), len(seeds), problem.hoops[1]
    goal, count, hoops = rows[:, 0:2], rows[:, 2].astype(np.int64), rows[:, PLACED:].reshape(n, most, PER_HOOP)
    there = np.arange(most) < count[:, None]
    hoops = np.where(there[:, :, None], hoops, 0.0)
    points = np.concatenate([np.zeros((n, 1, 2)), goal[:, None], hoops[:, :, 0:2]], axis=1)
    direction = np.stack([np.cos(hoops[:, :, 2]), np.sin(hoops[:, :, 2])], axis=-1)
    return Scene(
        quadrotor=problem.quadrotor,
        tolerance=problem.tolerance,
        dt=problem.dt,
        start=np.zeros((n, 2)),
        goal=goal,
        hoop_centre=hoops[:, :, 0:2],
        hoop_direction=np.where(there[:, :, None], direction, 0.0),
        hoop_diameter=hoops[:, :, 3],
        hoop_count=count,
        floor=np.full(n, -np.inf),
        ceiling=np.full(n, np.inf),
        bounds=np.concatenate([points.min(axis=1) - BOUNDS_MARGIN, points.max(axis=1) + BOUNDS_MARGIN], axis=1),
        max_steps=np.full(n, problem.max_steps),
        last_step=np.full(n, problem.max_steps),
        thrust_factor=np.ones(n),
        wind=np.zeros((n, 2)),
        delay=np.zeros(n, dtype=np.int64),
    )
