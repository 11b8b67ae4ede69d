"""TODO experiments/cli/play.py."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.terminal import messages

EXAMPLES = "Example: flatquad play hoop --speed 0.25; flatquad play slalom --video slalom.mp4"


def play(
    scenario: Annotated[
        str, typer.Argument(help="Name of a scenario or distribution; `flatquad list` shows them.")
    ] = "hoop",
    speed: Annotated[float, typer.Option(help="How fast time passes; 1 is real time, and too fast for most.")] = 0.25,
    ghost: Annotated[bool, typer.Option(help="Fly against the best flight known.")] = True,
    video: Annotated[Path | None, typer.Option(help="Write what is seen to an .mp4 or .gif file.")] = None,
) -> None:
    """Fly it yourself, with arrow keys or a gamepad, against the ghost of the best flight known.

    Left and right turn, up and down are full and least thrust; with nothing held it hovers.
    R flies again, space pauses, G hides the ghost, [ and ] change the speed, Q quits.
    """
    from experiments.play import window

    session = window.play(scenario, speed, ghost, video)
    if session.best_steps:
        messages.print(f"best flight: {session.best_steps} steps")
    if video is not None:
        messages.print(f"video: {video.resolve()}", soft_wrap=True)
