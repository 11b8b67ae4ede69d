"""The states and thrust actions of an episode, recorded for rendering.

    recorder = EpisodeRecorder(problem, render_mode, ghost)    # when the environment is created
    recorder.start(info)                                       # at reset
    recorder.add(thrust_action, info)                          # at each step
    recorder.draw(scenario)                                    # at render

Recording costs little, because many environments that could render never do. pygame is loaded at the first picture.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Array
from flatgym.rendering.renderer import SIZE, Renderer, check_ghost, check_mode, check_pygame
from flatgym.scenarios.catalogue import Problem
from flatgym.scenarios.reference import ghost_states, reference
from flatgym.scenarios.scenario import Scenario


class EpisodeRecorder:
    """Records the current episode and draws it.

    Args:
        problem: scenario or distribution of the environment.
        mode: "human", "rgb_array" or None. Warns if pygame is missing for "rgb_array"; the first picture raises.
        ghost: True for the best-known solution of a named scenario, states (n, 5) of another trajectory, or False.
        scored: whether to show K*; False for disturbed vehicles, which K* does not apply to.
        size: width and height of the pictures [px].

    Raises:
        ValueError: for an unknown mode, and for ghost=True without a best-known solution.
        ImportError: for mode "human" if the extra "render" is not installed.
    """

    def __init__(
        self,
        problem: Problem,
        mode: str | None,
        ghost: bool | ArrayLike = False,
        *,
        scored: bool = True,
        size: tuple[int, int] = SIZE,
    ) -> None:
        check_mode(mode)
        if mode is not None:
            _look_for_pygame(mode)
        self.mode, self.scored, self.size = mode, scored, size
        self.ghost = _ghost(problem, ghost)
        self._renderer: Renderer | None = None
        self._states: list[Array] = []
        self._actions: list[float] = []
        self._passed: list[int] = []
        self._outcome = ""

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy, without surfaces and window; a copy makes its own."""
        return self.__dict__ | {"_renderer": None}

    def start(self, info: dict[str, Any]) -> None:
        """Start an episode with the info of reset."""
        self._states, self._actions, self._passed = [info["state"].copy()], [], [info["hoops_passed"]]
        self._outcome = info["outcome"]

    def add(self, thrust_action: float, info: dict[str, Any]) -> None:
        """Add a step: its first action, which commands the thrust, and the info after it."""
        self._states.append(info["state"].copy())
        self._actions.append(thrust_action)
        self._passed.append(info["hoops_passed"])
        self._outcome = info["outcome"]

    def draw(self, scenario: Scenario) -> NDArray[np.uint8] | None:
        """Return a picture of the episode so far, shape (height, width, 3); in mode "human" show it, and return None.

        Args:
            scenario: the scenario of the episode.

        Raises:
            RuntimeError: before the first episode, and without a mode.
            ImportError: if the extra "render" is not installed.
        """
        if self.mode is None:
            raise RuntimeError('there are no pictures without a render_mode; choose "human" or "rgb_array"')
        if not self._states:
            raise RuntimeError("there is nothing to render yet; call reset() first")
        states, k_star = np.array(self._states), self._k_star(scenario)
        if self._renderer is None:
            self._renderer = Renderer(scenario, self.mode, k_star=k_star, ghost=self.ghost, size=self.size)
        self._renderer.set_scenario(scenario, k_star, self.ghost)
        clipped = np.clip(self._actions, -1.0, 1.0)
        thrusts = scenario.quadrotor.control(np.stack([clipped, np.zeros_like(clipped)], axis=-1))[:, 0]
        return self._renderer.draw(states, thrusts, int(self._passed[-1]), str(self._outcome))

    def close(self) -> None:
        """Close the window; the next picture opens it again."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _k_star(self, scenario: Scenario) -> int | None:
        """Return K*, which belongs to episodes of an undisturbed vehicle from the scenario's start; None otherwise."""
        if not self.scored or self._passed[0] or not np.array_equal(self._states[0], scenario.start_state):
            return None
        known = reference(scenario)
        return known.k_star if known else None


def _look_for_pygame(mode: str) -> None:
    """Raise an ImportError if pygame is missing; for "rgb_array" only warn.

    Stable-Baselines3's `make_vec_env` asks for "rgb_array" also where nothing is ever rendered.
    """
    try:
        check_pygame()
    except ImportError as error:
        if mode == "human":
            raise
        warnings.warn(f"render() will fail: {error}", stacklevel=4)  # where the environment is created


def _ghost(problem: Problem, ghost: bool | ArrayLike) -> Array | None:
    """Return the states of the ghost, shape (n, 5), or None."""
    if isinstance(ghost, (bool, np.bool_)):
        return ghost_states(problem) if ghost else None
    return check_ghost(ghost)
