"""FlatQuad-v0 as a batch of PyTorch tensors that never leave their device.

    envs = FlatQuadTorchVectorEnv(4096, "hoop", device="cuda")
    observations, infos = envs.reset(seed=0)
    observations, rewards, terminated, truncated, infos = envs.step(actions)    # tensors in, tensors out

The interface is that of `FlatQuadVectorEnv`, and vehicle i of a batch seeded with s repeats the episodes of a scalar
environment seeded with s + i. Everything is a tensor on the device, also the scenarios of later episodes, which are
drawn there. The differences:

    actions     must be a tensor on the device of the environment
    infos       `outcome` is an index into `flatgym.OUTCOMES`; in mode SAME_STEP `final_obs` has rows for all vehicles,
                of which those under `_final_obs` count
    not finite  an action that is not finite ends its episode out of bounds; to raise an error, the device would have to
                wait for the host at every step
    gradients   none: they flow through the functions of `flatgym.task`
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from flatgym.extras import require

require("torch", "torch", "array_api_compat")

import numpy as np
import torch

from flatgym import task
from flatgym.arrays import convert, library
from flatgym.envs.config import EnvConfig
from flatgym.envs.resetting import (
    OPTIONS,
    check_autoreset,
    check_mask,
    check_num_envs,
    check_options,
    check_seed,
    requested_hoops,
    requested_states,
    scenario_k_star,
    vector_seeds,
)
from flatgym.envs.spaces import action_space, controls_of, observation_space
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import DEFAULT_SCENARIO, ProblemLike
from flatgym.scenarios.counter_words import halves
from flatgym.scenarios.distributions import Distribution
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.reference import k_star_of
from flatgym.task.drawing import draw, sensor_noise
from flatgym.task.scene import FLYING, GOAL, TIME_LIMIT, EpisodeState, Scene

Tensor = torch.Tensor
Infos = dict[str, Any]


class FlatQuadTorchVectorEnv(gym.vector.VectorEnv[Tensor, Tensor, Tensor]):
    """n vehicles as tensors; see the module for the differences from `FlatQuadVectorEnv`.

    Args:
        num_envs, scenario, reward, observation: as in FlatQuadVectorEnv.
        wind, thrust_gain, mass, action_delay, sensor_noise, autoreset_mode, max_episode_steps: as there.
        device: the device of all tensors.
        dtype: torch.float64, which equals the scalar environment to 1e-10, or torch.float32, which is faster.

    Raises:
        ValueError: naming the argument, its value and what is allowed.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: ProblemLike = DEFAULT_SCENARIO,
        reward: str = "shaped",
        observation: str = "features",
        *,
        wind: float = 0.0,
        thrust_gain: float = 0.0,
        mass: float = 0.0,
        action_delay: int = 0,
        sensor_noise: float = 0.0,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        device: str | torch.device = "cpu",
        dtype: torch.dtype = torch.float32,
    ) -> None:
        check_num_envs(num_envs)
        if dtype not in (torch.float32, torch.float64):
            raise ValueError(f"dtype must be torch.float32 or torch.float64, got {dtype}")
        disturbances = Disturbances(wind, thrust_gain, mass, action_delay, sensor_noise)
        self.config = EnvConfig(
            catalogue.problem(scenario), reward, observation, disturbances, steps_most=max_episode_steps
        )
        self.num_envs, self.dtype, self.device = num_envs, dtype, torch.device(device)
        self.autoreset_mode = check_autoreset(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.render_mode = None
        self.single_observation_space, self.single_action_space = observation_space(observation), action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seeds, self._episodes = self._whole(0), self._whole(0)
        self._scene = self._draw(torch.arange(num_envs, device=self.device))
        self._episode = task.initial(self._scene)
        self._ended = torch.zeros(num_envs, dtype=torch.bool, device=self.device)
        self._k_star = self._whole(0)
        self._pending = torch.zeros((action_delay + 1, num_envs, 2), dtype=dtype, device=self.device)
        self._begun = False

    @torch.no_grad()
    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Tensor, Infos]:
        """Start episodes; arguments and errors as for `FlatQuadVectorEnv.reset`, options as arrays or tensors."""
        options = {key: convert(value) for key, value in check_options(options, (*OPTIONS, "reset_mask")).items()}
        wanted = options.pop("reset_mask", None)
        chosen = np.ones(self.num_envs, dtype=bool) if wanted is None else check_mask(wanted, self.num_envs)
        if not (self._begun or chosen.all()):
            raise gym.error.ResetNeeded("the first reset() must start all episodes, without a reset_mask")
        super().reset(seed=None if seed is None or isinstance(seed, Sequence) else check_seed(seed))
        seeds = vector_seeds(seed, self.num_envs, self._begun, self.np_random)
        mask, before = self._tensor(chosen), dict(vars(self))
        if seeds is not None:
            self._seeds = torch.where(mask, self._tensor(seeds.astype(np.int64)), self._seeds)
            self._episodes = torch.where(mask, -1, self._episodes)
        self._start(mask)
        if options:
            try:
                self._episode = self._episode.put(mask, self._requested(options, chosen))
            except ValueError:
                vars(self).update(before)
                raise
            self._k_star = torch.where(mask, 0, self._k_star)
        elif seeds is not None and isinstance(self.config.problem, Distribution):
            known = np.nan_to_num(k_star_of(self.config.problem, seeds), nan=0.0).astype(np.int64)
            self._k_star = torch.where(mask, self._tensor(known), self._k_star)
        self._ended, self._begun = self._ended & ~mask, True
        return self._observe(), self._infos(torch.ones_like(mask))

    @torch.no_grad()
    def step(self, actions: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Infos]:
        """Advance all vehicles by one step; shapes (n, 2) -> (n, 19), (n,), (n,), (n,).

        Raises:
            gym.error.ResetNeeded: as FlatQuadVectorEnv.step.
            TypeError: for actions that are not a tensor of floating point numbers.
            ValueError: for actions of another shape or on another device; no vehicle has moved then.
        """
        if not self._begun:
            raise gym.error.ResetNeeded("call reset() before the first step()")
        self._check_actions(actions)
        if self.autoreset_mode == AutoresetMode.DISABLED and self._ended.any():
            over = torch.nonzero(self._ended)[:5, 0].tolist()
            raise gym.error.ResetNeeded(f"the episodes of vehicles {over} have ended; reset them first")
        before, idle = self._episode, self._ended
        control = controls_of(self.config.quadrotor, actions.to(self.dtype))
        after = self._episode = task.advance(self._scene, before, self._delayed(control))
        reward = task.reward(self._scene, before, after, self.config.shaped)
        reward, end = torch.where(idle, 0.0, reward), torch.where(idle, FLYING, after.outcome)
        infos, ended = {}, end != FLYING
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            if ended.any():
                final = {key: _masked(value, ended) for key, value in self._infos(ended).items()}
                infos = {"final_obs": self._observe(), "_final_obs": ended.clone(), "final_info": final}
                infos["_final_info"] = ended.clone()
                self._start(ended)
        else:
            self._start(idle)
            self._ended = ended
        infos |= self._infos(torch.ones_like(ended))
        truncated = end == TIME_LIMIT
        return self._observe(), reward, ended & ~truncated, truncated, infos

    def _check_actions(self, actions: Any) -> None:
        if library(actions) != "torch" or not actions.is_floating_point():
            kind = actions.dtype if hasattr(actions, "dtype") else type(actions).__name__
            raise TypeError(
                f"actions must be a torch tensor of floating point numbers, got {kind} of {library(actions)}; "
                "torch.as_tensor(actions, dtype=torch.float32, device=envs.device) makes one"
            )
        if actions.shape != (self.num_envs, 2):
            raise ValueError(f"actions must have shape {(self.num_envs, 2)}, got {tuple(actions.shape)}")
        if actions.device != self._seeds.device:
            raise ValueError(
                f"actions must be on {self._seeds.device}, got {actions.device}; move them with .to(device)"
            )

    def _start(self, mask: Tensor) -> None:
        """Start the next episodes of the vehicles under the mask."""
        self._episodes = self._episodes + mask
        if isinstance(self.config.problem, Distribution) or self.config.disturbances.active:
            rows = torch.nonzero(mask)[:, 0]
            self._scene = self._scene.put(rows, self._draw(rows))
        self._episode = self._episode.put(mask, task.initial(self._scene))
        self._k_star = torch.where(mask, scenario_k_star(self.config), self._k_star)

    def _draw(self, rows: Tensor) -> Scene:
        """Return the scene of the present episodes of some vehicles."""
        seed, episode = halves(self._seeds[rows]), halves(self._episodes[rows])
        scene = draw(self.config.problem, seed, episode, self.dtype, self.config.disturbances)
        last = torch.full_like(scene.max_steps, self.config.last_step)
        return replace(scene, tolerance=self.config.tolerance, last_step=last)

    def _requested(self, options: dict[str, Any], chosen: Any) -> EpisodeState:
        """Return the episodes as the options of `reset` request them."""
        episode, state = self._episode, requested_states(options, self.num_envs)
        passed = requested_hoops(options, chosen, self._scene.hoop_count.cpu().numpy)
        if state is not None:
            episode = replace(episode, state=self._tensor(state.copy()).to(self.dtype))
        return episode if passed is None else replace(episode, hoops_passed=self._tensor(passed))

    def _delayed(self, control: Tensor) -> Tensor:
        """Queue controls (n, 2) and return those that act in this step; hover before the first one acts."""
        slots = len(self._pending)
        if slots == 1:
            return control
        rows, steps, delay = torch.arange(self.num_envs, device=self.device), self._episode.steps, self._scene.delay
        self._pending[steps % slots, rows] = control
        hover = torch.tensor([self.config.quadrotor.gravity, 0.0], dtype=self.dtype, device=self.device)
        return torch.where((delay > steps)[:, None], hover, self._pending[(steps - delay) % slots, rows])

    def _observe(self) -> Tensor:
        """Return the observations of the measured states: the states plus sensor noise."""
        measured, disturbances = self._episode, self.config.disturbances
        if disturbances.sensor_noise:
            seed, episode = halves(self._seeds), halves(self._episodes)
            noise = sensor_noise(disturbances, seed, episode, measured.steps, self.dtype)
            measured = replace(measured, state=measured.state + noise)
        return task.observe(self._scene, measured, self.config.observation)

    def _infos(self, mask: Tensor) -> Infos:
        """Return the infos, in tensors that the caller may change."""
        now = self._episode
        infos = {
            "state": now.state.clone(),
            "time": now.steps.to(self.dtype) * self.config.dt,
            "steps": now.steps.clone(),
            "hoops_passed": now.hoops_passed.clone(),
            "is_success": now.outcome == GOAL,
            "outcome": now.outcome.clone(),
            "k_star": self._k_star.clone(),
        }
        return infos | {f"_{key}": mask.clone() for key in infos}

    def _whole(self, value: int) -> Tensor:
        return torch.full((self.num_envs,), value, dtype=torch.int64, device=self.device)

    def _tensor(self, values: Any) -> Tensor:
        return torch.as_tensor(values, device=self.device)


def _masked(values: Tensor, mask: Tensor) -> Tensor:
    """Return values with rows of zeros outside the mask."""
    return torch.where(mask.reshape(-1, *(1,) * (values.ndim - 1)), values, torch.zeros_like(values))
