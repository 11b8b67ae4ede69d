"""FlatQuad-v0, many vehicles at once: a thin Gymnasium shell around a fleet.

Equal to the scalar environment step for step: vehicle i of a batch seeded with s flies the episodes of a
scalar environment seeded with s + i. In SAME_STEP mode the observation returned with the end of an
episode is already the first of the next one, and `final_obs`, `final_info` hold the last of the old one;
in NEXT_STEP mode (the default, as in Gymnasium) the step after the end ignores its action and returns
the first observation of the next episode.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from flatgym.envs.config import EnvConfig, Starts
from flatgym.envs.env import fleet_of
from flatgym.envs.fleet import OUTCOME, REWARD, TIME, Mask, Record, Seeds, StepResult
from flatgym.envs.outcome_words import OutcomeStrings
from flatgym.envs.resetting import OPTIONS, begin, check_options, check_seed, known_k_star
from flatgym.envs.spaces import action_space, observation_space, take_actions
from flatgym.quadrotor import Array
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import DEFAULT_SCENARIO, Problem, ProblemLike
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.scenario import Tolerance
from flatgym.validation import numbers

INFO_KEYS = ("state", "time", "steps", "hoops_passed", "is_success", "outcome", "k_star")
_NOBODY = np.zeros(0, dtype=np.intp)


class FlatQuadVectorEnv(gym.vector.VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """`gym.make_vec("FlatQuad-v0", num_envs=n, vectorization_mode="vector_entry_point")`.

    Args:
        num_envs: number of vehicles n.
        scenario, reward, observation, starts: as in FlatQuadEnv.
        wind, thrust_gain, mass, action_delay, sensor_noise: disturbances, as in FlatQuadEnv, each vehicle its own.
        autoreset_mode: NEXT_STEP (default), SAME_STEP or DISABLED.
        max_episode_steps: truncate after so many steps, should that be sooner than the scenario's time limit.
        render_mode: must be None; render with the scalar environment.
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
        if isinstance(num_envs, bool) or not isinstance(num_envs, (int, np.integer)) or num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, got {num_envs}")
        if render_mode is not None:
            raise ValueError(
                f"the batched environment does not render, got render_mode={render_mode!r}; "
                "gym.make gives the scalar one, which does"
            )
        disturbances = Disturbances(wind, thrust_gain, mass, action_delay, sensor_noise)
        problem = catalogue.problem(scenario)
        course = EnvConfig(problem, reward, observation, disturbances, starts, max_episode_steps)
        self.num_envs = num_envs
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.render_mode = None
        self.single_observation_space, self.single_action_space = observation_space(observation), action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.fleet = fleet_of(course, num_envs, self.autoreset_mode == AutoresetMode.SAME_STEP)
        self._all = np.ones(num_envs, dtype=bool)
        self._all.flags.writeable = False  # it is handed out as the mask of every info
        self._masks = {f"_{key}": self._all for key in INFO_KEYS}
        self._words = OutcomeStrings(num_envs)
        self._begun = False
        self._ended: Mask = np.zeros(num_envs, dtype=bool)
        self._k_star = np.full(num_envs, np.nan)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy: the mask of all stays read-only."""
        self.__dict__.update(state)
        self._all.flags.writeable = False

    @property
    def course(self) -> EnvConfig:
        """What the environment is made with."""
        return self.fleet.course

    @property
    def scenario(self) -> Problem:
        """What is flown: a scenario, or the distribution from which each episode's is drawn."""
        return self.course.problem

    def set_tolerance(self, tolerance: Tolerance) -> None:
        """Let something else count as arrived from the next step on, as a curriculum may want it."""
        self.fleet.set_tolerance(tolerance)
        self._k_star = np.full(self.num_envs, np.nan)  # known for the tolerance of before

    def set_share(self, share: float) -> None:
        """Let another share of the episodes begin in the pool of starts."""
        self.fleet.set_share(share)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start new flights.

        Args:
            seed: of the first vehicle, the others counting on from it; or one for each.
            options: as in the scalar environment, for all or for each; and "reset_mask", who starts anew, shape (n,).
        """
        seed = seed.tolist() if isinstance(seed, np.ndarray) else seed
        options = check_options(options, (*OPTIONS, "reset_mask"))
        wanted = options.pop("reset_mask", None)
        mask = self._all if wanted is None else self._check_mask(wanted)
        if not (self._begun or mask.all()):
            raise gym.error.ResetNeeded("the first reset() must start all flights, without a reset_mask")
        super().reset(seed=None if seed is None or isinstance(seed, Sequence) else check_seed(seed))
        seeds = self._seeds(seed)
        observation, record = begin(self.fleet, mask, seeds, options)
        self._begun, self._ended = True, self._ended & ~mask
        known = np.full(self.num_envs, np.nan) if options else known_k_star(self.fleet, first=seeds is not None)
        self._k_star = np.where(mask, known, self._k_star)
        return observation, self._infos(record, self._all, np.flatnonzero(record.numbers[OUTCOME]))

    def step(
        self, actions: ArrayLike
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Fly all vehicles one step; shapes (n, 2) -> (n, 19), (n,), (n,), (n,)."""
        if not self._begun:
            raise gym.error.ResetNeeded("call reset() before the first step()")
        take_actions(actions, self.fleet.actions)
        if self.autoreset_mode == AutoresetMode.DISABLED and self._ended.any():
            raise gym.error.ResetNeeded(
                f"flights {np.flatnonzero(self._ended)[:5].tolist()} have ended; reset them first"
            )
        flown = self.fleet.step()
        terminated, truncated, _ = flown.record.flags
        before, begun = self._k_star, flown.record.counts[0] == 0
        if begun.any():
            self._k_star = np.where(begun, known_k_star(self.fleet, first=False), before)
        infos = self._infos(flown.record, self._all, _NOBODY if flown.final is not None else flown.ended)
        if self.autoreset_mode == AutoresetMode.DISABLED:
            self._ended = terminated | truncated
        elif flown.final is not None:
            infos |= self._final(flown, terminated | truncated, before)
        return flown.observation, flown.record.numbers[REWARD], terminated, truncated, infos

    def _final(self, flown: StepResult, mask: Mask, k_star: Array) -> dict[str, Any]:
        assert flown.final is not None
        assert flown.final_observation is not None
        observations = np.full(self.num_envs, None, dtype=object)
        for i in flown.ended:
            observations[i] = flown.final_observation[i]
        return {
            "final_obs": observations,
            "_final_obs": mask,
            "final_info": self._infos(Record.of(np.where(mask, flown.final, 0.0)), mask, flown.ended)
            | {"k_star": np.where(mask, k_star, 0.0)},
            "_final_info": mask,
        }

    def _infos(self, record: Record, mask: Mask, rows: NDArray[np.intp]) -> dict[str, Any]:
        """Return the infos; `rows` are the flights that have an outcome."""
        infos = {
            "state": record.numbers[0:5].T,
            "time": record.numbers[TIME],
            "steps": record.counts[0],
            "hoops_passed": record.counts[1],
            "is_success": record.flags[2],
            "outcome": self._words.of(rows, record.numbers[OUTCOME][rows]),
            "k_star": self._k_star.copy(),
        }
        return infos | (self._masks if mask is self._all else {f"_{key}": mask for key in infos})

    def _seeds(self, seed: int | Sequence[int | None] | None) -> Seeds | None:
        """Return a seed for each vehicle, or None to go on with the seeds there are."""
        if seed is None:
            if self._begun:
                return None
            seed = int(self.np_random.integers(2**63))
        if not isinstance(seed, Sequence):
            return np.uint64(check_seed(seed)) + np.arange(self.num_envs, dtype=np.uint64)
        if len(seed) != self.num_envs:
            raise ValueError(f"seed must be one number or {self.num_envs}, got {len(seed)}")
        drawn = self.np_random.integers(2**63, size=self.num_envs)
        return np.array([drawn[i] if one is None else check_seed(one) for i, one in enumerate(seed)], dtype=np.uint64)

    def _check_mask(self, mask: ArrayLike) -> Mask:
        values = numbers("options['reset_mask']", mask)
        if values.shape != (self.num_envs,) or values.dtype != np.bool_:
            raise ValueError(f"options['reset_mask'] must be booleans of shape ({self.num_envs},), got {mask!r}")
        return values


def _mode(mode: Any) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        known = ", ".join(repr(one.value) for one in AutoresetMode)
        raise ValueError(f"unknown autoreset_mode {mode!r}; known: {known}") from None
