"""The batched environment as a Stable-Baselines3 VecEnv.

SB3 has its own vector interface: it resets finished episodes within the step, expects their last observation in
`infos[i]["terminal_observation"]`, and uses `TimeLimit.truncated` to tell truncation from termination.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from flatgym.envs.vector import FlatQuadVectorEnv
from flatgym.scenarios.catalogue import DEFAULT_SCENARIO, ProblemLike


class FlatQuadVecEnv(VecEnv):
    """A FlatQuadVectorEnv in SAME_STEP mode behind SB3's VecEnv.

    The info of an episode's last step is that of the environment (`outcome`, `is_success`, ...) with SB3's `episode`
    record (return, length) added. Other steps have an empty info, because building n dictionaries a step would cost
    more than the simulation.
    """

    def __init__(self, envs: FlatQuadVectorEnv) -> None:
        if envs.autoreset_mode != AutoresetMode.SAME_STEP:
            raise ValueError(f"SB3 resets within the step: needs SAME_STEP autoreset, got {envs.autoreset_mode}")
        self.envs = envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self._returns = np.zeros(envs.num_envs)

    def reset(self) -> NDArray[np.float32]:
        """Reset all episodes; seeds given by `seed()` are used once."""
        seed = next((seed for seed in self._seeds if seed is not None), None)
        observations, _ = self.envs.reset(seed=seed)
        self._returns[:] = 0.0
        self._reset_seeds()
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Store the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step the environment and translate the results."""
        observations, rewards, terminated, truncated, arrays = self.envs.step(self._actions)
        done = terminated | truncated
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
        return observations, rewards.astype(np.float32), done, infos

    def close(self) -> None:
        """Close the batched environment."""
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

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:  # noqa: ARG002
        """Return False for each index; the vehicles of a batch have no wrappers."""
        return [False] * len(self._rows(indices))

    def _rows(self, indices: VecEnvIndices) -> Sequence[int]:
        return list(self._get_indices(indices))

    def _all(self, indices: VecEnvIndices) -> None:
        if len(self._rows(indices)) != self.num_envs:
            raise ValueError(f"the {self.num_envs} vehicles share one environment; indices={indices} would split them")


def make_vec_env(
    scenario: ProblemLike = DEFAULT_SCENARIO, num_envs: int = 256, *, seed: int | None = None, **arguments: Any
) -> FlatQuadVecEnv:
    """Return `num_envs` vehicles of a scenario as one SB3 VecEnv.

    Args:
        scenario: a name, a Scenario or a Distribution.
        num_envs: number of vehicles.
        seed: seed of the first reset.
        arguments: further arguments of FlatQuadVectorEnv, such as reward, observation, wind, starts.
    """
    envs = FlatQuadVectorEnv(num_envs, scenario, autoreset_mode=AutoresetMode.SAME_STEP, **arguments)
    adapter = FlatQuadVecEnv(envs)
    if seed is not None:
        adapter.seed(seed)
    return adapter
