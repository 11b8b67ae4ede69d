"""A fleet written with the NumPy functions of `flatgym.task`: the reference for `CompiledFleet`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatgym import task
from flatgym.envs.config import EnvConfig
from flatgym.envs.fleet import Fleet, Mask, Record, ResetResult, Seeds, StepResult, not_finite
from flatgym.quadrotor import Array
from flatgym.scenarios.counter_rng import START, uniform
from flatgym.scenarios.distributions import Distribution
from flatgym.task.drawing import placed_scene
from flatgym.task.scene import FLYING, Integers, Scene


class NumpyFleet(Fleet):
    """n vehicles advanced by `flatgym.task`; see `Fleet`."""

    def _allocate(self) -> None:
        self.actions = np.zeros((self.n, 2))
        self.scene = scene_of(self.config, self.seeds, self.episodes)
        self.current = task.initial(self.scene)
        self.waits = np.zeros(self.n, dtype=bool)  # the next step starts an episode
        self.pending = np.zeros((self.config.disturbances.action_delay + 1, self.n, 2))

    def _apply_config(self) -> None:
        self.scene = replace(self.scene, tolerance=self.config.tolerance)

    def reset(self, mask: Mask, state: Array | None = None, hoops_passed: Integers | None = None) -> ResetResult:
        """Start episodes; see `Fleet.reset`."""
        self._start(np.flatnonzero(mask))
        if state is not None:
            self.current = self.current.put(mask, replace(self.current, state=state))
        if hoops_passed is not None:
            self.current = self.current.put(mask, replace(self.current, hoops_passed=hoops_passed))
        self.waits = self.waits & ~mask
        return self._observe(), Record.of(self._numbers(np.zeros(self.n), np.zeros(self.n)))

    def step(self) -> StepResult:
        """Advance all vehicles by one step; see `Fleet.step`."""
        if not np.isfinite(self.actions).all():
            raise not_finite(self.actions)
        before, idle = self.current, self.waits
        after = self.current = task.advance(self.scene, before, self._delayed(self.controls()))
        reward = np.where(idle, 0.0, task.reward(self.scene, before, after, self.config.shaped))
        end = np.where(idle, FLYING, after.outcome)
        if idle.any():
            self._start_next(idle)
        self.waits, final_observation, final = end != FLYING, None, None
        if self.same_step and self.waits.any():
            final_observation, final = self._observe(), self._numbers(reward, end)
            self._start_next(self.waits)
            self.waits = np.zeros(self.n, dtype=bool)
        record, ended = Record.of(self._numbers(reward, end)), np.flatnonzero(end)
        return StepResult(self._observe(), record, ended, final_observation, final)

    def _observe(self) -> NDArray[np.float32]:
        """Return the observations of the measured states: the states plus sensor noise."""
        measured, disturbances = self.current, self.config.disturbances
        if disturbances.sensor_noise:
            steps = measured.steps.astype(np.uint64)
            noise = disturbances.noise(self.seeds, self.episodes, steps)
            measured = replace(measured, state=measured.state + noise)
        return task.observe(self.scene, measured, self.config.observation)

    def _delayed(self, control: Array) -> Array:
        """Queue controls (n, 2) and return those that act in this step; hover before the first one acts."""
        slots = len(self.pending)
        if slots == 1:
            return control
        rows, steps, delay = np.arange(self.n), self.current.steps, self.scene.delay
        self.pending[steps % slots, rows] = control
        due = self.pending[(steps - delay) % slots, rows]
        hover = np.array([self.config.quadrotor.gravity, 0.0])
        return np.where((delay > steps)[:, None], hover, due)

    def _start_next(self, mask: Mask) -> None:
        self.ids[1, mask] += np.uint64(1)
        self._start(np.flatnonzero(mask))

    def _start(self, rows: NDArray[np.intp]) -> None:
        """Start the episodes `self.episodes` of the vehicles `rows`, from the pool with probability `share`."""
        seeds, episodes = self.seeds[rows], self.episodes[rows]
        if isinstance(self.config.problem, Distribution) or self.config.disturbances.active:
            self.scene = self.scene.put(rows, scene_of(self.config, seeds, episodes))
        fresh, mask = task.initial(self.scene), np.zeros(self.n, dtype=bool)
        mask[rows] = True
        self.current = self.current.put(mask, fresh)
        if (pool := self.config.starts) is not None:
            drawn = uniform(seeds, episodes, np.uint64(START)) < self.share
            row = (uniform(seeds, episodes, np.uint64(START + 1)) * len(pool.state)).astype(np.int64)[drawn]
            self.current.state[rows[drawn]] = pool.state[row]
            self.current.hoops_passed[rows[drawn]] = pool.hoops_passed[row]

    def _numbers(self, reward: Array, end: NDArray[Any]) -> Array:
        """Return `Record.numbers`, shape (11, n)."""
        now = self.current
        time = now.steps * self.config.dt
        return np.vstack([now.state.T, now.steps, now.hoops_passed, now.outcome, reward, end, time])


def scene_of(config: EnvConfig, seeds: Seeds, episodes: Seeds) -> Scene:
    """Return the scene of n episodes, with sampled scenarios and disturbances; seeds and numbers have shape (n,)."""
    problem, n = config.problem, len(seeds)
    if isinstance(problem, Distribution):
        scene = placed_scene(problem, problem.draw(seeds, episodes))
    else:
        scene = Scene.of([problem]).repeat(n)
    factor, wind, delay = config.disturbances.draw(seeds, episodes)
    return replace(
        scene,
        tolerance=config.tolerance,
        hoop_diameter=scene.hoop_diameter + 2 * config.margin,
        floor=scene.floor - config.margin,
        ceiling=scene.ceiling + config.margin,
        last_step=np.full(n, config.last_step),
        thrust_factor=factor,
        wind=wind,
        delay=delay,
    )
