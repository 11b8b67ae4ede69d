"""FlatQuad-v0, many vehicles at once: the same verbs over a batch, with autoreset.

Equal to the scalar environment step for step. In SAME_STEP mode the observation returned with the
end of an episode is already the first of the next one, and `final_obs`, `final_info` hold the
last of the old one; in NEXT_STEP mode (the default, as in Gymnasium) the step after the end
ignores its action and returns the first observation of the next episode.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from flatgym import catalogue, task
from flatgym.catalogue import DEFAULT_SCENARIO, ScenarioLike
from flatgym.env import action_space, begin, check_actions, check_reward, observation_space
from flatgym.quadrotor import Array
from flatgym.scene import Integers, Scene, Situation

Starts = Callable[[np.random.Generator, int], tuple[Array, Integers]]
"""Draws n start states (n, 5) with the numbers of hoops already passed (n,), for training."""


class FlatQuadVectorEnv(gym.vector.VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """`gym.make_vec("FlatQuad-v0", num_envs=n, vectorization_mode="vector_entry_point")`.

    Args:
        num_envs: number of vehicles n.
        scenario: a name of `flatgym.SCENARIOS` or a Scenario, flown by all.
        reward: "shaped" or "sparse".
        autoreset_mode: NEXT_STEP (default), SAME_STEP or DISABLED.
        max_episode_steps: truncate after so many steps instead of the scenario's time limit.
        starts: draws start states for training; by default every flight starts at the start.
        render_mode: must be None; render with the scalar environment.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: ScenarioLike = DEFAULT_SCENARIO,
        reward: str = "shaped",
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        starts: Starts | None = None,
        render_mode: str | None = None,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, got {num_envs}")
        if render_mode is not None:
            raise ValueError(f"the batched environment does not render, got render_mode={render_mode!r}")
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.render_mode = None
        self.shaped = check_reward(reward)
        self.max_episode_steps = max_episode_steps
        self.starts = starts
        self.single_observation_space, self.single_action_space = observation_space(), action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.set_scenario(scenario)
        self._situation: Situation | None = None
        self._ended = np.zeros(num_envs, dtype=bool)

    def set_scenario(self, scenario: ScenarioLike) -> None:
        """Fly another scenario, or this one with another tolerance, from the next step on."""
        self.scenario = catalogue.scenario(scenario)
        self.scene = Scene.of([self.scenario] * self.num_envs)
        if self.max_episode_steps is not None:
            self.scene = replace(self.scene, max_steps=np.full(self.num_envs, self.max_episode_steps))

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start new flights; `options` as in the scalar environment, plus "reset_mask", shape (n,)."""
        super().reset(seed=seed if not isinstance(seed, list) else seed[0])
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        if options:
            one = begin(Scene.of([self.scenario]), options)
            fresh = Situation(*(np.repeat(getattr(one, name), self.num_envs, axis=0) for name in _FIELDS))
        else:
            fresh = self._fresh()
        mask = np.ones(self.num_envs, dtype=bool) if mask is None else self._check_mask(mask)
        self._situation = fresh if self._situation is None else self._situation.put(mask, fresh)
        self._ended = self._ended & ~mask
        return task.observe(self.scene, self._situation), self._infos(self._situation)

    def step(
        self, actions: ArrayLike
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Fly all vehicles one step; shapes (n, 2) -> (n, 19), (n,), (n,), (n,)."""
        before = self._situation
        if before is None:
            raise gym.error.ResetNeeded("call reset() before the first step()")
        actions = check_actions(actions, (self.num_envs, 2))
        idle = self._ended
        if idle.any() and self.autoreset_mode == AutoresetMode.DISABLED:
            raise gym.error.ResetNeeded(f"flights {np.flatnonzero(idle)[:5].tolist()} have ended; reset them first")
        after = task.advance(self.scene, before, self.scene.quadrotor.control(actions))
        reward = task.reward(self.scene, before, after, self.shaped)
        if idle.any():
            after, reward = after.put(idle, self._fresh()), np.where(idle, 0.0, reward)
        terminated, truncated = after.terminated, after.truncated
        ended = terminated | truncated
        infos: dict[str, Any] = {}
        if self.autoreset_mode == AutoresetMode.SAME_STEP and ended.any():
            infos["final_obs"], infos["_final_obs"] = self._final_observations(after, ended), ended
            infos["final_info"], infos["_final_info"] = self._infos(after, ended), ended
            after = after.put(ended, self._fresh())
        else:
            self._ended = ended
        self._situation = after
        return task.observe(self.scene, after), reward, terminated, truncated, infos | self._infos(after)

    def _fresh(self) -> Situation:
        situation = task.initial(self.scene)
        if self.starts is None:
            return situation
        state, passed = self.starts(self.np_random, self.num_envs)
        return replace(situation, state=state, hoops_passed=passed)

    def _final_observations(self, situation: Situation, ended: NDArray[np.bool_]) -> NDArray[Any]:
        rows = np.full(self.num_envs, None, dtype=object)
        observations = task.observe(self.scene, situation)
        for i in np.flatnonzero(ended):
            rows[i] = observations[i]
        return rows

    def _infos(self, situation: Situation, mask: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        mask = np.ones(self.num_envs, dtype=bool) if mask is None else mask
        arrays = task.info(self.scene, situation)
        return arrays | {f"_{key}": mask for key in arrays}

    def _check_mask(self, mask: ArrayLike) -> NDArray[np.bool_]:
        values = np.asarray(mask)
        if values.shape != (self.num_envs,) or values.dtype != np.bool_:
            raise ValueError(f"options['reset_mask'] must be booleans of shape ({self.num_envs},), got {mask!r}")
        return values


_FIELDS = ("state", "steps", "hoops_passed", "outcome")
