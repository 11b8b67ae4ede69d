"""The states and thrusts of an episode, recorded for rendering.

    recorder = EpisodeRecorder(problem, render_mode, ghost)    # when the environment is created
    recorder.start(scenario, info)                             # at reset
    recorder.add(thrust, info)                                 # at each step
    recorder.draw()                                            # at render

Without a render mode nothing is recorded and pygame is not loaded. In mode "human" a window shows every step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Array
from flatgym.rendering.renderer import SIZE, Renderer, check_ghost, check_mode
from flatgym.scenarios.catalogue import Problem
from flatgym.scenarios.reference import ghost_states, reference
from flatgym.scenarios.scenario import Scenario


class EpisodeRecorder:
    """Records the current episode and draws it.

    Args:
        problem: scenario or distribution of the environment.
        mode: "human", "rgb_array" or None.
        ghost: True for the best-known solution of a named scenario, states (n, 5) of another trajectory, or False.
        scored: whether to show K*; False for disturbed vehicles, which K* does not apply to.
        size: width and height of the pictures [px].

    Raises:
        ValueError: for an unknown mode, and for ghost=True without a best-known solution.
        ImportError: if the extra "render" is not installed.
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
        self.mode, self.scored, self.size = mode, scored, size
        self.ghost = _ghost(problem, ghost)
        self._renderer: Renderer | None = None
        self._states: list[Array] = []

    def start(self, scenario: Scenario, info: dict[str, Any]) -> None:
        """Start an episode of a scenario with the info of reset."""
        if self.mode is None:
            return
        self.scenario, self._info = scenario, info
        self._states, self._thrusts = [info["state"].copy()], list[float]()
        # K* belongs to episodes from the scenario's start.
        at_start = np.array_equal(info["state"], scenario.start_state) and info["hoops_passed"] == 0
        known = reference(scenario) if self.scored and at_start else None
        self._k_star = known.k_star if known else None
        self._show()

    def add(self, thrust: float, info: dict[str, Any]) -> None:
        """Add a step: its commanded thrust [m/s^2] and the info after it."""
        if self.mode is None:
            return
        self._info = info
        self._states.append(info["state"].copy())
        self._thrusts.append(thrust)
        self._show()

    def draw(self) -> NDArray[np.uint8] | None:
        """Return a picture of the episode so far, shape (height, width, 3); None in mode "human" or without a mode.

        Raises:
            RuntimeError: before the first episode.
        """
        if self.mode is None:
            return None
        if not self._states:
            raise RuntimeError("there is nothing to render yet; call reset() first")
        return None if self.mode == "human" else self._draw()

    def close(self) -> None:
        """Close the window; may be called again."""
        if self._renderer is not None:
            self._renderer.close()

    def _show(self) -> None:
        if self.mode == "human":
            self._draw()

    def _draw(self) -> NDArray[np.uint8] | None:
        if self._renderer is None:
            assert self.mode is not None
            self._renderer = Renderer(self.scenario, self.mode, k_star=self._k_star, ghost=self.ghost, size=self.size)
        self._renderer.set_scenario(self.scenario, self._k_star, self.ghost)
        return self._renderer.draw(
            np.array(self._states), self._thrusts, int(self._info["hoops_passed"]), str(self._info["outcome"])
        )


def _ghost(problem: Problem, ghost: bool | ArrayLike) -> Array | None:
    """Return the states of the ghost, shape (n, 5), or None."""
    if isinstance(ghost, (bool, np.bool_)):
        return ghost_states(problem) if ghost else None
    return check_ghost(ghost)
