"""Rendering of episodes: as arrays, in a window, and as videos.

    renderer = Renderer(scenario, "rgb_array", k_star=70, ghost=ghost_states("hoop"))
    pixels = renderer.draw(states, thrusts, hoops_passed, outcome)

Arrays need no display. pygame and imageio are imported on first use.
"""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.extras import require
from flatgym.files import write_whole
from flatgym.quadrotor import Array
from flatgym.rendering.instant import Instant
from flatgym.scenarios.scenario import Scenario
from flatgym.validation import numbers

if TYPE_CHECKING:
    from flatgym.rendering.canvas import Canvas
    from flatgym.rendering.picture import Picture

SIZE = (960, 720)
"""Default width and height of a picture [px]."""
SIZE_LEAST = 64
"""Minimum width and height of a picture [px]."""
MODES = ("human", "rgb_array")
VIDEOS = (".mp4", ".gif")
PLAIN_PYGAME = (
    "pictures need the package pygame-ce, and the package pygame is installed in its place; run: "
    "pip uninstall pygame, then: pip install --force-reinstall pygame-ce"
)
UNSEEN = ("dummy", "offscreen")
"""Drivers that SDL falls back to where there is no display, by name."""


def load_pygame() -> None:
    """Import pygame-ce without its greeting.

    Raises:
        ImportError: with the pip command, if it is not installed, or the package pygame in its place.
    """
    check_pygame()
    with contextlib.redirect_stdout(io.StringIO()):
        import pygame
    if not getattr(pygame, "IS_CE", False):  # both packages write to the same folder
        raise ImportError(PLAIN_PYGAME)


def check_pygame() -> None:
    """Raise the ImportError of `load_pygame` without importing pygame."""
    require("render", "pygame")
    try:
        version("pygame-ce")
    except PackageNotFoundError:
        raise ImportError(PLAIN_PYGAME) from None


def check_mode(mode: str | None) -> None:
    """Raise a ValueError for an unknown render mode."""
    if mode is not None and mode not in MODES:
        raise ValueError(f"unknown render_mode {mode!r}; known: {', '.join(MODES)}, or None for no pictures")


class Renderer:
    """Draws episodes of one scenario.

    Args:
        scenario: the scenario.
        mode: "rgb_array" returns pictures, "human" shows them in a window in real time.
        k_star: K*, or None.
        ghost: states of another trajectory to draw, one for each step, shape (n, 5), or None.
        size: width and height of the pictures [px].

    Attributes:
        is_open: False after the window was closed; nothing is drawn then.
    """

    def __init__(
        self,
        scenario: Scenario,
        mode: str = "rgb_array",
        *,
        k_star: int | None = None,
        ghost: ArrayLike | None = None,
        size: tuple[int, int] = SIZE,
    ) -> None:
        check_mode(mode)
        if len(size) != 2 or min(size) < SIZE_LEAST:
            raise ValueError(f"size must be a width and a height of at least {SIZE_LEAST} px, got {size!r}")
        load_pygame()
        self.mode, self.size, self.is_open = mode, size, True
        self.picture: Picture | None = None
        self.set_scenario(scenario, k_star, None if ghost is None else check_ghost(ghost))
        self._window = Window("FlatQuad", size, 1 / scenario.dt) if mode == "human" else None

    def set_scenario(self, scenario: Scenario, k_star: int | None = None, ghost: Array | None = None) -> None:
        """Switch to another scenario; setting the same scenario again costs nothing."""
        from flatgym.rendering.picture import Picture

        shown = self.picture
        if shown is None or shown.scenario != scenario or shown.k_star != k_star or shown.ghost is not ghost:
            self.picture = Picture(scenario, self.size, k_star, ghost)

    def draw(
        self, states: Array, thrusts: ArrayLike, hoops_passed: int = 0, outcome: str = "flying"
    ) -> NDArray[np.uint8] | None:
        """Draw an episode at an instant.

        Args:
            states: states from the start on, shape (k+1, 5).
            thrusts: thrusts of the k steps [m/s^2], shape (k,).
            hoops_passed: number of hoops passed.
            outcome: one of flatgym.OUTCOMES.

        Returns:
            RGB values, shape (height, width, 3); None in mode "human".
        """
        if not self.is_open:
            return None
        assert self.picture is not None
        instant = Instant(np.asarray(states, dtype=np.float64), np.asarray(thrusts), hoops_passed, outcome)
        if self._window is None:
            return self.picture.pixels(instant)
        self._window.show(self.picture.draw(instant))
        if self._window.close_requested():
            self.close()
        return None

    def close(self) -> None:
        """Close the window; may be called again."""
        self.is_open = False
        if self._window is not None:
            self._window.close()


class Window:
    """A separate window; several environments can have one each.

    Args:
        title: its title.
        size: width and height [px].
        frames_per_second: maximum rate of `show`; 0 is unlimited.

    Raises:
        OSError: if no window can be opened.

    Attributes:
        visible: False where SDL finds no display and draws in memory instead. True if the variable SDL_VIDEODRIVER
            names a driver.
    """

    def __init__(self, title: str, size: tuple[int, int], frames_per_second: float) -> None:
        load_pygame()
        import pygame

        try:
            pygame.display.init()
            self._window: Any = pygame.Window(title, size)
        except pygame.error as error:
            raise OSError(f"no window can be opened ({error}); without a display use rgb_array, or a video") from None
        self.visible = "SDL_VIDEODRIVER" in os.environ or pygame.display.get_driver() not in UNSEEN
        self._clock, self.frames_per_second = pygame.time.Clock(), frames_per_second

    def show(self, canvas: Canvas) -> None:
        """Show a picture and wait until the next is due."""
        self._window.get_surface().blit(canvas.shown(), (0, 0))
        self._window.flip()
        self._clock.tick(self.frames_per_second)

    def close_requested(self) -> bool:
        """Return whether the user has asked to close this window; requests for other windows stay in the queue."""
        import pygame

        pygame.event.pump()
        if pygame.event.peek(pygame.QUIT):
            return True
        asked = pygame.event.get(pygame.WINDOWCLOSE)
        for event in asked:
            if event.window is not self._window:
                pygame.event.post(event)
        return any(event.window is self._window for event in asked)

    def close(self) -> None:
        """Close the window; may be called again."""
        if self._window is not None:
            self._window.destroy()
            self._window = None


def check_ghost(ghost: ArrayLike) -> Array:
    """Return the states of a ghost as float64, shape (n, 5); a ValueError for other shapes and nonfinite values."""
    states = numbers("the ghost", ghost).astype(np.float64)
    if states.ndim != 2 or states.shape[1] != 5 or len(states) == 0:
        raise ValueError(f"the ghost must be states [x, z, vx, vz, theta] of shape (K+1, 5), got shape {states.shape}")
    if not np.isfinite(states).all():
        raise ValueError("the ghost's states must be finite, got NaN or infinity")
    return states


def write_video(path: str | Path, frames: Iterable[NDArray[np.uint8]], fps: float = 50.0) -> Path:
    """Write pictures to an .mp4 or .gif file, atomically.

    Args:
        path: the file; its suffix selects the format. Its folder is created if it does not exist.
        frames: pictures of equal size, each of shape (height, width, 3).
        fps: frames per second; at most 50 in a GIF.

    Raises:
        ValueError: for another suffix, and without frames.
        ImportError: if the extra "render" is not installed.
    """
    path = Path(path)
    if path.suffix not in VIDEOS:
        raise ValueError(f"unknown ending {path.suffix!r} of {path.name}; known: {', '.join(VIDEOS)}")
    require("render", "imageio", *(["imageio_ffmpeg"] if path.suffix == ".mp4" else []))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, lambda temporary: _write_frames(temporary, frames, fps))
    return path


def _write_frames(path: Path, frames: Iterable[NDArray[np.uint8]], fps: float) -> None:
    """Write pictures to a file; a ValueError without frames."""
    import imageio.v2 as imageio

    options: dict[str, Any] = (
        {"fps": fps, "macro_block_size": 2, "quality": 8}
        if path.suffix == ".mp4"
        else {"duration": round(1000 / fps), "loop": 0}
    )
    writer: Any = imageio.get_writer(path, **options)
    number = 0
    with writer:
        for frame in frames:
            writer.append_data(frame)
            number += 1
    if number == 0:
        raise ValueError("a video needs at least one frame, got none")
