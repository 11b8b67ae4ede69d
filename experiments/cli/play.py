"""`flatquad play`: the task by keyboard or gamepad."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.files import check_output
from experiments.terminal import messages

EXAMPLES = "Example: flatquad play hoop --speed 0.25; flatquad play slalom --video slalom.mp4"


def play(
    scenario: Annotated[
        str, typer.Argument(help="A scenario or distribution: a name that `flatquad list` shows, or a file.")
    ] = "hoop",
    speed: Annotated[float, typer.Option(help="Speed of the simulation relative to real time.")] = 0.25,
    ghost: Annotated[bool, typer.Option(help="Show the best-known flight as a ghost.")] = True,
    video: Annotated[
        Path | None, typer.Option(help="Record a video, an .mp4 or .gif file.", show_default=False)
    ] = None,
) -> None:
    """Fly the quadrotor by arrow keys or gamepad, against the ghost of the best-known flight.

    Left and right turn; up and down give full and least thrust; without a key it hovers. R restarts, space pauses,
    G hides the ghost, [ and ] change the speed, Q quits.
    """
    from experiments.play import window
    from flatgym.rendering.renderer import VIDEOS

    if video is not None:
        check_output(video, VIDEOS)
    session = window.play(scenario, speed, ghost, video)
    if session.best_steps:
        messages.print(f"best flight: {session.best_steps} steps")
    if video is not None:
        messages.print(f"video: {video.resolve()}", soft_wrap=True)
