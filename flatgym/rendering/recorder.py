"""What an environment remembers of an episode, so that it can be drawn: the states flown and the thrusts.

    film = Film(problem, render_mode, ghost)    # when the environment is made
    film.begin(scenario, info)                  # at reset
    film.add(action, info)                      # at each step
    film.draw()                                 # at render

Without a mode nothing is remembered and nothing loaded. In a window every step is shown as it is flown.
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
    """The present episode, and the renderer that draws it.

    Args:
        problem: what the environment flies.
        mode: "human", "rgb_array" or None.
        ghost: True for the best flight known of a named scenario, the states of another flight, shape (n, 5), or False.
        scored: whether K* may be told, as disturbed flights are not comparable.
        size: width and height of the pictures [px].

    Raises:
        ValueError: for an unknown mode, and where no flight is known; it names the way out.
        ImportError: where the extra is missing.
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

    def begin(self, scenario: Scenario, info: dict[str, Any]) -> None:
        """Begin an episode of a scenario with the info of reset."""
        if self.mode is None:
            return
        self.scenario, self._info = scenario, info
        self._states, self._thrusts = [info["state"].copy()], list[float]()
        # From elsewhere than the start, K* is not the fewest steps.
        at_start = np.array_equal(info["state"], scenario.start_state) and info["hoops_passed"] == 0
        known = reference(scenario) if self.scored and at_start else None
        self._k_star = known.k_star if known else None
        self._show()

    def add(self, action: ArrayLike, info: dict[str, Any]) -> None:
        """Add a step: its action, shape (2,), and the info after it."""
        if self.mode is None:
            return
        control = self.scenario.quadrotor.control(np.clip(action, -1.0, 1.0))
        self._info = info
        self._states.append(info["state"].copy())
        self._thrusts.append(float(control[0]))
        self._show()

    def draw(self) -> NDArray[np.uint8] | None:
        """Return the picture of the episode as it stands, shape (height, width, 3); None in a window or without a mode.

        Raises:
            RuntimeError: before the first episode.
        """
        if self.mode is None:
            return None
        if not self._states:
            raise RuntimeError("there is nothing to render yet; call reset() first")
        return None if self.mode == "human" else self._draw()

    def close(self) -> None:
        """Close the window; again has no effect."""
        if self._renderer is not None:
            self._renderer.close()

    def _show(self) -> None:
        if self.mode == "human":
            self._draw()

    def _draw(self) -> NDArray[np.uint8] | None:
        if self._renderer is None:
            assert self.mode is not None
            self._renderer = Renderer(self.scenario, self.mode, k_star=self._k_star, ghost=self.ghost, size=self.size)
        self._renderer.turn_to(self.scenario, self._k_star, self.ghost)
        return self._renderer.draw(
            np.array(self._states), self._thrusts, int(self._info["hoops_passed"]), str(self._info["outcome"])
        )


def _ghost(problem: Problem, ghost: bool | ArrayLike) -> Array | None:
    if isinstance(ghost, (bool, np.bool_)):
        return ghost_states(problem) if ghost else None
    return check_ghost(ghost)
