"""The batched environment as a Stable-Baselines3 VecEnv.

SB3 has its own vector interface: it resets finished episodes within the step, expects their last observation in
`infos[i]["terminal_observation"]`, and uses `TimeLimit.truncated` to tell truncation from termination.
"""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from flatgym.envs.levels import Levels
from flatgym.envs.resetting import check_options
from flatgym.envs.vector import INFO_KEYS, FlatQuadVectorEnv
from flatgym.rendering.recorder import EpisodeRecorder
from flatgym.scenarios.catalogue import DEFAULT_SCENARIO, ProblemLike
from flatgym.scenarios.scenario import Scenario
from flatgym.validation import whole

SEED_SPACING = 2**30
"""Distance of the environment seeds of two consecutive seeds; larger than any number of vehicles, and than all seeds
of scored episodes."""


class FlatQuadVecEnv(VecEnv):
    """A FlatQuadVectorEnv in SAME_STEP mode behind SB3's VecEnv.

    The info of an episode's last step is that of the environment (`outcome`, `is_success`, ...) with SB3's `episode`
    record (return, length) added, as by SB3's Monitor. Other steps have an empty info, because building n dictionaries
    a step would cost more than the simulation; `arrays` holds the same values of all vehicles.

    Pictures show the first vehicle.

    Args:
        envs: the batched environment.
        render_mode: "rgb_array" or None.

    Attributes:
        arrays: infos of the last reset or step, by key, each of shape (n, ...); see `FlatQuadVectorEnv`.
    """

    def __init__(self, envs: FlatQuadVectorEnv, render_mode: str | None = None) -> None:
        if envs.autoreset_mode != AutoresetMode.SAME_STEP:
            raise ValueError(f"SB3 resets within the step: needs SAME_STEP autoreset, got {envs.autoreset_mode}")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f'render_mode must be "rgb_array" or None, got {render_mode!r}')
        self.envs, self.arrays = envs, dict[str, Any]()
        self.recorder = EpisodeRecorder(envs.scenario, render_mode, scored=not envs.config.disturbances.active)
        envs.render_mode = render_mode  # read by VecEnv, also through wrappers
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self.metadata: dict[str, Any] = self.metadata | {"render_fps": 1 / envs.scenario.dt}
        self._returns = np.zeros(envs.num_envs)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Choose the seeds of the next reset, and return them.

        Vehicle i gets (seed + 1) * SEED_SPACING + i. So the tasks of two seeds differ, and none is a scored episode.

        Args:
            seed: a whole number in 0..2^32 - 1, as SB3's own; None chooses one.
        """
        first = super().seed(seed)[0]
        return self.seed_exactly((whole("seed", first, 0, 2**32 - 1) + 1) * SEED_SPACING)

    def seed_exactly(self, first: int) -> Sequence[int | None]:
        """Choose first + i as the seed of vehicle i at the next reset, and return all."""
        self._seeds = [first + i for i in range(self.num_envs)]
        return self._seeds

    def set_options(self, options: list[dict[str, Any]] | dict[str, Any] | None = None) -> None:
        """Choose the options of the next reset, see `FlatQuadEnv`: one dict for all vehicles or a list, one for each.

        Raises:
            ValueError: for unknown options, and for a list of another length.
        """
        if isinstance(options, (list, tuple)) and len(options) != self.num_envs:
            raise ValueError(f"options must be a dict or a list of {self.num_envs}, got {len(options)}")
        for one in options if isinstance(options, (list, tuple)) else [options]:
            check_options(one)
        super().set_options(options)

    def reset(self) -> NDArray[np.float32]:
        """Reset all episodes; what `seed()` and `set_options()` have set is used once."""
        seeds = None if self._seeds[0] is None else self._seeds
        alike: dict[tuple[str, ...], list[int]] = {}
        for i, options in enumerate(self._options):
            alike.setdefault(tuple(sorted(options or {})), []).append(i)
        if len(alike) > 1 and not self.arrays:  # the first reset has to start all vehicles
            self.envs.reset(seed=seeds)
            seeds = self.envs.fleet.seeds.tolist()
        for keys, rows in alike.items():
            observations, self.arrays = self.envs.reset(seed=seeds, options=self._batch(keys, rows))
        self.reset_infos = [self._info(i) for i in range(self.num_envs)]
        self._returns[:] = 0.0
        self._reset_seeds()
        self._reset_options()
        self.recorder.start(self._info(0))
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Store the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step the environment and translate the results."""
        observations, rewards, terminated, truncated, arrays = self.envs.step(self._actions)
        done, self.arrays = terminated | truncated, arrays
        self._returns += rewards
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(done):
            final = {key: value[i] for key, value in arrays["final_info"].items() if not key.startswith("_")}
            infos[i] = final | {
                "terminal_observation": arrays["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i]),
                "episode": {"r": float(self._returns[i]), "l": int(final["steps"]), "t": float(final["time"])},
            }
        self._returns[done] = 0.0
        if self.render_mode is not None:
            self._record(bool(done[0]))
        return observations, rewards.astype(np.float32), done, infos

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return a picture of the first vehicle, shape (720, 960, 3), as a list of one.

        Raises:
            ValueError: without render_mode="rgb_array".
        """
        if self.render_mode is None:
            raise ValueError('there are no pictures without make_vec_env(..., render_mode="rgb_array")')
        problem, fleet = self.envs.scenario, self.envs.fleet
        if isinstance(problem, Scenario):
            return [self.recorder.draw(problem)]
        return [self.recorder.draw(problem.scenario(int(fleet.seeds[0]), int(fleet.episodes[0])))]

    def close(self) -> None:
        """Close the batched environment."""
        self.recorder.close()
        self.envs.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the batched environment, once for each index."""
        return [getattr(self.envs, attr_name)] * len(self._rows(indices))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the batched environment, which all vehicles share."""
        self._all(indices)
        setattr(self.envs, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the batched environment, once for all vehicles."""
        self._all(indices)
        return [getattr(self.envs, method_name)(*method_args, **method_kwargs)] * self.num_envs

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """Return for each index whether it is SB3's Monitor, whose records the infos have; there are no wrappers."""
        return [wrapper_class is Monitor] * len(self._rows(indices))

    def _info(self, i: int) -> dict[str, Any]:
        return {key: self.arrays[key][i] for key in INFO_KEYS}

    def _record(self, started: bool) -> None:
        """Record the first vehicle for the pictures."""
        if started:
            self.recorder.start(self._info(0))
        else:
            self.recorder.add(float(self.envs.fleet.actions[0, 0]), self._info(0))

    def _batch(self, keys: tuple[str, ...], rows: list[int]) -> dict[str, Any]:
        """Return the options of vehicles that have options of the same keys, as those of the batched environment."""
        mask = np.isin(np.arange(self.num_envs), rows)
        if mask.all() and not keys:
            return {}
        first = self._options[rows[0]]
        batch = {key: [self._options[i][key] if mask[i] else first[key] for i in range(self.num_envs)] for key in keys}
        return batch | ({} if mask.all() else {"reset_mask": mask})

    def _rows(self, indices: VecEnvIndices) -> Sequence[int]:
        return list(self._get_indices(indices))

    def _all(self, indices: VecEnvIndices) -> None:
        if len(self._rows(indices)) != self.num_envs:
            raise ValueError(f"the {self.num_envs} vehicles share one environment; indices={indices} would split them")


class NumberedActions(VecEnvWrapper):
    """A VecEnv whose actions are numbers of `flatgym.envs.levels.Levels`, for `DQN("MlpPolicy", ...)`."""

    def __init__(self, venv: VecEnv, levels: Levels) -> None:
        super().__init__(venv, action_space=levels)
        self.levels = levels

    def reset(self) -> Any:
        """Reset all episodes."""
        return self.venv.reset()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Start a step with numbers, shape (n,)."""
        self.venv.step_async(self.levels.actions(actions))

    def step_wait(self) -> VecEnvStepReturn:
        """End the step."""
        return self.venv.step_wait()


def make_vec_env(
    scenario: ProblemLike = DEFAULT_SCENARIO,
    num_envs: int = 256,
    *,
    seed: int | None = None,
    render_mode: str | None = None,
    **arguments: Any,
) -> FlatQuadVecEnv:
    """Return `num_envs` vehicles of a scenario as one SB3 VecEnv.

    Args:
        scenario: a name, a Scenario or a Distribution.
        num_envs: number of vehicles.
        seed: seed of the first reset; see `FlatQuadVecEnv.seed`.
        render_mode: "rgb_array" for pictures of the first vehicle, or None.
        arguments: further arguments of FlatQuadVectorEnv, such as reward, observation, wind, starts.

    Raises:
        TypeError: for unknown arguments, with the known ones and the closest one.
    """
    _check_arguments(arguments)
    envs = FlatQuadVectorEnv(num_envs, scenario, autoreset_mode=AutoresetMode.SAME_STEP, **arguments)
    adapter = FlatQuadVecEnv(envs, render_mode)
    if seed is not None:
        adapter.seed(seed)
    return adapter


def _check_arguments(arguments: dict[str, Any]) -> None:
    known = {*inspect.signature(FlatQuadVectorEnv).parameters, "seed"} - {"autoreset_mode"}
    for name in arguments:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise TypeError(f"unknown argument {name!r} of make_vec_env; known: {', '.join(sorted(known))}{hint}")
