"""Fly it yourself: `flatquad play hoop`, against the ghost of the best flight known, in slow motion.

Events, from pygame or from a script, go into a Session; each frame lets a fiftieth of a second pass and is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.play.session import COMMANDS, STEERING, Controls, Session
from flatgym.rendering import SIZE, Window, load_pygame, write_video

if TYPE_CHECKING:
    from flatgym.rendering.canvas import Canvas
    from flatgym.rendering.picture import Picture

FRAMES_PER_SECOND = 50
HELP = "arrows fly   R again   space pause   G ghost   [ ] speed   Q quit"
STICK = 32767
"""The number that a gamepad's axis reports at its end."""
Events = Callable[[], Iterable[Any]]
"""Returns the pygame events since it was last called."""


def play(problem: str, speed: float = 0.25, ghost: bool = True, video: Path | None = None) -> Session:
    """Open a window and fly until the person quits; return the session.

    Args:
        problem: name of a scenario or distribution.
        speed: of time; 1 is real time.
        ghost: whether to draw the best flight known beside.
        video: a .mp4 or .gif file to write what was seen to.
    """
    session = Session(problem, speed, ghost)
    window = Window(f"FlatQuad: {session.scenario.name}", SIZE, FRAMES_PER_SECOND)
    try:
        seen = frames(session, pygame_events(), window)
        if video is None:
            for _ in seen:
                pass
        else:
            write_video(video, (canvas.pixels() for canvas in seen), FRAMES_PER_SECOND)
    finally:
        window.close()
    return session


def frames(session: Session, events: Events, window: Window | None = None) -> Iterator[Canvas]:
    """Yield what is seen, frame by frame, until the session is over; the next frame is drawn over it."""
    controls, picture = Controls(), None
    while True:
        for event in events():
            obey(session, controls, event)
        if session.over:
            return
        session.advance(controls, 1 / FRAMES_PER_SECOND)
        picture = fitting(session, picture)
        canvas = picture.draw(session.instant, session.with_ghost)
        captions(canvas, picture.unit, session)
        if window is not None:
            window.show(canvas)
        yield canvas


def fitting(session: Session, picture: Picture | None) -> Picture:
    """Return the picture, or a new one when another scenario is flown."""
    load_pygame()
    from flatgym.rendering.picture import Picture

    if picture is not None and picture.scenario == session.scenario:
        return picture
    known = session.reference
    return Picture(session.scenario, SIZE, known.k_star if known else None, session.ghost)


def obey(session: Session, controls: Controls, event: Any) -> None:
    """Let an event of pygame change what is held, or command the session."""
    import pygame

    if event.type in (pygame.QUIT, pygame.WINDOWCLOSE):
        session.command("quit")
    elif event.type == pygame.KEYDOWN:
        name = pygame.key.name(event.key)
        if name in STEERING:
            controls.held.add(name)
        elif name in COMMANDS:
            session.command(COMMANDS[name])
    elif event.type == pygame.KEYUP:
        controls.held.discard(pygame.key.name(event.key))
    elif event.type == pygame.WINDOWFOCUSLOST:
        # Keys let go elsewhere are never reported.
        controls.held.clear()
    elif event.type == pygame.CONTROLLERAXISMOTION:
        controls.axes[event.axis] = event.value / STICK
    elif event.type == pygame.CONTROLLERBUTTONDOWN:
        button = {pygame.CONTROLLER_BUTTON_A: "restart", pygame.CONTROLLER_BUTTON_START: "pause"}.get(event.button)
        session.command(button or "")


def pygame_events() -> Events:
    """Return a source of all events of keyboard, windows and gamepads, those plugged in later included."""
    import pygame
    from pygame._sdl2 import controller

    controller.init()
    pads: dict[int, Any] = {}

    def events() -> Iterable[Any]:
        happened = pygame.event.get()
        for event in happened:
            if event.type == pygame.CONTROLLERDEVICEADDED:
                # A gamepad reports as long as somebody holds on to it.
                pads[event.device_index] = controller.Controller(event.device_index)
        return happened

    return events


def captions(canvas: Canvas, unit: float, session: Session) -> None:
    """Write what the person may want to know: the keys, the speed, the best flight, and the result at the end."""
    from flatgym.rendering.dashboard import FOOTER
    from flatgym.rendering.palette import FAINT

    width, height = canvas.size
    pace = f"speed {session.speed:.2g}x" + (f"   best {session.best_steps} steps" if session.best_steps else "")
    canvas.text(pace, (150 * unit, 64 * unit), 18 * unit, FAINT)
    canvas.text(HELP, (width - 84 * unit, height - FOOTER / 2 * unit), 17 * unit, FAINT, "midright")
    if session.outcome != "flying":
        banner(canvas, unit, session.verdict(), "R to fly again")
    elif session.paused:
        banner(canvas, unit, "paused", "space to fly on")
    elif session.waiting > 0:
        banner(canvas, unit, f"ready: {session.waiting:.0f}", "touch a key to start")


def banner(canvas: Canvas, unit: float, text: str, below: str) -> None:
    """Write two lines on a card low in the middle."""
    from flatgym.rendering.canvas import text_width
    from flatgym.rendering.palette import FAINT, INK, PALE, WHITE

    middle = canvas.size[0] / 2
    wide = max(text_width(text, 30 * unit), text_width(below, 20 * unit)) + 60 * unit
    top, tall = canvas.size[1] - 150 * unit, 84 * unit
    canvas.panel(middle - wide / 2 - 2 * unit, top - 2 * unit, wide + 4 * unit, tall + 4 * unit, PALE, 16 * unit)
    canvas.panel(middle - wide / 2, top, wide, tall, WHITE, 14 * unit)
    canvas.text(text, (middle, top + 30 * unit), 30 * unit, INK, "center")
    canvas.text(below, (middle, top + 60 * unit), 20 * unit, FAINT, "center")
