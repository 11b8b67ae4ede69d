"""FlatQuad-v0: the batched Gymnasium environment, a fleet of n vehicles.

Vehicle i of a batch seeded with s repeats the episodes of a scalar environment seeded with s + i, step for step. The
autoreset mode decides when the next episode starts:

    NEXT_STEP   (default, as in Gymnasium) the step after the end ignores its action and returns the first observation
                of the next episode
    SAME_STEP   the step that ends an episode returns the first observation of the next one; `final_obs` and
                `final_info` hold the last of the old one
    DISABLED    the caller resets ended episodes with `options={"reset_mask": mask}`
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from flatgym.envs.config import EnvConfig, Starts
from flatgym.envs.fleet import OUTCOME, REWARD, TIME, Mask, Record, StepResult
from flatgym.envs.fleet_selection import make_fleet
from flatgym.envs.outcome_strings import OutcomeStrings
from flatgym.envs.resetting import (
    OPTIONS,
    check_autoreset,
    check_mask,
    check_num_envs,
    check_options,
    check_seed,
    known_k_star,
    scenario_k_star,
    start_episodes,
    vector_seeds,
)
from flatgym.envs.spaces import action_space, observation_space, take_actions
from flatgym.envs.specification import plain_spec
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import DEFAULT_SCENARIO, Problem, ProblemLike
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.scenario import Tolerance

INFO_KEYS = ("state", "time", "steps", "hoops_passed", "is_success", "outcome", "k_star")
_NONE = np.zeros(0, dtype=np.intp)


class FlatQuadVectorEnv(gym.vector.VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """`gym.make_vec("FlatQuad-v0", num_envs=n, vectorization_mode="vector_entry_point")`; see `FlatQuadEnv`.

    Args:
        num_envs: number of vehicles n.
        scenario, reward, observation, starts: as in FlatQuadEnv.
        wind, thrust_gain, mass, action_delay, sensor_noise: disturbances as in FlatQuadEnv, sampled for each vehicle.
        autoreset_mode: NEXT_STEP (default), SAME_STEP or DISABLED.
        max_episode_steps: truncate after this many steps if that is earlier than the scenario's time limit.
        render_mode: must be None; only the scalar environment renders.

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
        starts: Starts | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        check_num_envs(num_envs)
        if render_mode is not None:
            raise ValueError(
                f"the batched environment does not render, got render_mode={render_mode!r}; "
                "gym.make gives the scalar one, which does"
            )
        disturbances = Disturbances(wind, thrust_gain, mass, action_delay, sensor_noise)
        problem = catalogue.problem(scenario)
        config = EnvConfig(problem, reward, observation, disturbances, starts, max_episode_steps)
        self._spec: EnvSpec | None = None
        self.num_envs = num_envs
        self.autoreset_mode = check_autoreset(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.render_mode = None
        self.single_observation_space, self.single_action_space = observation_space(observation), action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.fleet = make_fleet(config, num_envs, self.autoreset_mode == AutoresetMode.SAME_STEP)
        self._all = np.ones(num_envs, dtype=bool)
        self._all.flags.writeable = False  # every info returns it as a mask
        self._masks = {f"_{key}": self._all for key in INFO_KEYS}
        self._outcomes = OutcomeStrings(num_envs)
        self._begun = False
        self._ended = _NONE  # vehicles whose episode has ended and that have not been reset
        self._k_star = np.zeros(num_envs, dtype=np.int64)  # 0 where unknown

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy; NumPy's copy of the read-only mask is writable."""
        self.__dict__.update(state)
        self._all.flags.writeable = False

    @property
    def spec(self) -> EnvSpec | None:
        """Gymnasium's specification, as plain data; None without `gym.make_vec`."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        """Keep the specification as plain data."""
        self._spec = plain_spec(spec, self.config)

    @property
    def config(self) -> EnvConfig:
        """The configuration of the environment."""
        return self.fleet.config

    @property
    def scenario(self) -> Problem:
        """The scenario, or the distribution from which each episode's scenario is sampled."""
        return self.config.problem

    def set_tolerance(self, tolerance: Tolerance) -> None:
        """Replace the goal tolerance from the next step on; `k_star` of the current episodes becomes 0."""
        self.fleet.set_tolerance(tolerance)
        self._k_star = np.zeros(self.num_envs, dtype=np.int64)  # K* belongs to the old tolerance

    def set_share(self, share: float) -> None:
        """Replace the probability that an episode starts in the pool of starts."""
        self.fleet.set_share(share)

    def set_starts(self, starts: Starts) -> None:
        """Replace the pool of starts from the next episode on; its probability stays as it is."""
        self.fleet.set_starts(starts)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start episodes.

        Args:
            seed: seed of the first vehicle, that of vehicle i is seed + i; or a list of n seeds, in which None chooses
                a random one. Without a seed, the next episodes of the present seeds start.
            options: "state" and "hoops_passed" as in FlatQuadEnv, one for all vehicles or one for each; "reset_mask",
                the vehicles to reset, shape (n,), bool.

        Raises:
            gym.error.ResetNeeded: if the first call has a reset_mask that leaves out vehicles.
            ValueError: for seeds or options of a wrong shape or range; nothing has changed then.
        """
        seed = seed.tolist() if isinstance(seed, np.ndarray) else seed
        options = check_options(options, (*OPTIONS, "reset_mask"))
        wanted = options.pop("reset_mask", None)
        mask = self._all if wanted is None else check_mask(wanted, self.num_envs)
        if not (self._begun or mask.all()):
            raise gym.error.ResetNeeded("the first reset() must start all episodes, without a reset_mask")
        super().reset(seed=None if seed is None or isinstance(seed, Sequence) else check_seed(seed))
        seeds = vector_seeds(seed, self.num_envs, self._begun, self.np_random)
        observation, record = start_episodes(self.fleet, mask, seeds, options)
        self._begun, self._ended = True, self._ended[~mask[self._ended]]
        known = 0 if options else known_k_star(self.fleet, first=seeds is not None)
        self._k_star = np.where(mask, known, self._k_star)
        return observation, self._infos(record, self._all, np.flatnonzero(record.numbers[OUTCOME]))

    def step(
        self, actions: ArrayLike
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Advance all vehicles by one step; shapes (n, 2) -> (n, 19), (n,), (n,), (n,).

        Raises:
            gym.error.ResetNeeded: before the first reset; in mode DISABLED also if an ended episode was not reset.
            ValueError: for actions of another shape or not finite; no vehicle has moved then.
        """
        if not self._begun:
            raise gym.error.ResetNeeded("call reset() before the first step()")
        take_actions(actions, self.fleet.actions)
        if self.autoreset_mode == AutoresetMode.DISABLED and self._ended.size:
            raise gym.error.ResetNeeded(
                f"the episodes of vehicles {self._ended[:5].tolist()} have ended; reset them first"
            )
        result = self.fleet.step()
        terminated, truncated, _ = result.record.flags
        if result.final is not None:
            infos = self._final(result, terminated | truncated)
            self._start_next(result.ended)
            infos |= self._infos(result.record, self._all, _NONE)
        else:
            self._start_next(self._ended)
            infos = self._infos(result.record, self._all, result.ended)
            self._ended = result.ended
        return result.observation, result.record.numbers[REWARD], terminated, truncated, infos

    def _start_next(self, rows: NDArray[np.intp]) -> None:
        """Update K* of the vehicles that a step has reset."""
        if rows.size:
            self._k_star[rows] = scenario_k_star(self.config)

    def _final(self, result: StepResult, mask: Mask) -> dict[str, Any]:
        """Return the final observations and infos of the episodes under `mask`, before K* of the next is known."""
        assert result.final is not None
        assert result.final_observation is not None
        observations = np.full(self.num_envs, None, dtype=object)
        for i in result.ended:
            observations[i] = result.final_observation[i]
        return {
            "final_obs": observations,
            "_final_obs": mask,
            "final_info": self._infos(Record.of(np.where(mask, result.final, 0.0)), mask, result.ended)
            | {"k_star": np.where(mask, self._k_star, 0)},
            "_final_info": mask,
        }

    def _infos(self, record: Record, mask: Mask, rows: NDArray[np.intp]) -> dict[str, Any]:
        """Return the infos; `rows` are the vehicles whose outcome is not "flying"."""
        infos = {
            "state": record.numbers[0:5].T,
            "time": record.numbers[TIME],
            "steps": record.counts[0],
            "hoops_passed": record.counts[1],
            "is_success": record.flags[2],
            "outcome": self._outcomes.of(rows, record.numbers[OUTCOME][rows]),
            "k_star": self._k_star.copy(),
        }
        return infos | (self._masks if mask is self._all else {f"_{key}": mask for key in infos})
