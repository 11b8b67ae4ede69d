"""Progress as a reward, for evaluation during training: policies differ before the first success.

The shaped reward telescopes. Every episode that ends off the goal has the same return, minus the time limit minus the
potential of the start, so a mean return tells nothing about a policy that does not succeed yet.

    EvalCallback(Monitor(ProgressReward(gym.make("FlatQuad-v0", scenario="hoop"))), n_eval_episodes=1)
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from flatgym.task.scene import EpisodeState, Scene
from flatgym.task.shaping import remaining_path_length


class ProgressReward(gym.Wrapper[Any, Any, Any, Any]):
    """A FlatQuad environment whose reward is the rise of the episode's progress; not for training.

    With l the length of the way through the hoops ahead to the goal [m], the progress of an episode is
    1 - min l / l(start), so below 1 until it succeeds, and 2 - steps / max_steps when it succeeds. The return of an
    episode is its last progress: a success is above all failures, and a faster one above a slower one.
    `info["progress"]` is the progress so far.
    """

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        """Reset the environment; the progress is 0."""
        observation, info = self.env.reset(**arguments)
        self.problem = self.unwrapped.scenario  # type: ignore[attr-defined]
        self.scene = Scene.of([self.problem])
        self.whole = self._left(info)
        self.progress = 0.0
        return observation, info | {"progress": self.progress}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Step the environment; the reward is the rise of the progress."""
        observation, _, terminated, truncated, info = self.env.step(action)
        before = self.progress
        if info["is_success"]:
            self.progress = 2.0 - info["steps"] / self.problem.max_steps
        elif self.whole > 0:
            self.progress = max(before, 1.0 - self._left(info) / self.whole)
        return observation, self.progress - before, terminated, truncated, info | {"progress": self.progress}

    def _left(self, info: dict[str, Any]) -> float:
        """Return the length of the way through the hoops ahead to the goal [m]."""
        state, passed, zero = info["state"][None], np.array([info["hoops_passed"]]), np.zeros(1, dtype=np.int64)
        return float(remaining_path_length(self.scene, EpisodeState(state, zero, passed, zero))[0])
