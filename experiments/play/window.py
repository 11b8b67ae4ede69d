"""The window of `flatquad play`: manual flight in slow motion, against the best-known flight.

Events from pygame, or from a script, go to a Session. Each frame advances it by 1/50 s and draws it.
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
HELP = "arrows fly   R restart   space pause   G ghost   [ ] speed   Q quit"
STICK = 32767
"""Value of a gamepad axis at its end."""
Events = Callable[[], Iterable[Any]]
"""Returns the pygame events since the last call."""


def play(problem: str, speed: float = 0.25, ghost: bool = True, video: Path | None = None) -> Session:
    """Open a window, fly until the user quits, and return the session.

    Args:
        problem: name or file of a scenario or distribution.
        speed: speed of time; 1 is real time.
        ghost: whether to draw the best-known flight.
        video: a .mp4 or .gif file to record to.

    Raises:
        OSError: without a display.
    """
    session = Session(problem, speed, ghost)
    window = Window(f"FlatQuad: {session.scenario.name}", SIZE, FRAMES_PER_SECOND)
    if not window.visible:
        window.close()
        raise OSError("no display was found to fly on; the variable SDL_VIDEODRIVER can name a driver")
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
    """Yield the canvas of each frame until the session is over; the next frame reuses it."""
    controls, picture = Controls(), None
    while True:
        for event in events():
            handle(session, controls, event)
        if session.over:
            return
        session.advance(controls, 1 / FRAMES_PER_SECOND)
        picture = picture_of(session, picture)
        canvas = picture.draw(session.instant, session.show_ghost)
        captions(canvas, picture.unit, session)
        if window is not None:
            window.show(canvas)
        yield canvas


def picture_of(session: Session, picture: Picture | None) -> Picture:
    """Return the picture, or a new one if the scenario has changed."""
    load_pygame()
    from flatgym.rendering.picture import Picture

    if picture is not None and picture.scenario == session.scenario:
        return picture
    known = session.reference
    return Picture(session.scenario, SIZE, known.k_star if known else None, session.ghost)


def handle(session: Session, controls: Controls, event: Any) -> None:
    """Apply a pygame event: to the controls, or as a command to the session."""
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
        # The release of a key in another window is not reported.
        controls.held.clear()
    elif event.type == pygame.CONTROLLERAXISMOTION:
        controls.axes[event.axis] = event.value / STICK
    elif event.type == pygame.CONTROLLERBUTTONDOWN:
        button = {pygame.CONTROLLER_BUTTON_A: "restart", pygame.CONTROLLER_BUTTON_START: "pause"}.get(event.button)
        session.command(button or "")


def pygame_events() -> Events:
    """Return a source of all events of keyboard, window and gamepads, also of gamepads connected later."""
    import pygame
    from pygame._sdl2 import controller

    controller.init()
    pads: dict[int, Any] = {}

    def events() -> Iterable[Any]:
        happened = pygame.event.get()
        for event in happened:
            if event.type == pygame.CONTROLLERDEVICEADDED:
                # A gamepad reports events while there is a reference to its object.
                pads[event.device_index] = controller.Controller(event.device_index)
        return happened

    return events


def captions(canvas: Canvas, unit: float, session: Session) -> None:
    """Write the keys, the speed, the steps of the best flight so far, and the result at the end."""
    from flatgym.rendering.dashboard import FOOTER
    from flatgym.rendering.palette import FAINT

    width, height = canvas.size
    pace = f"speed {session.speed:.2g}x" + (f"   best {session.best_steps} steps" if session.best_steps else "")
    canvas.text(pace, (150 * unit, 64 * unit), 18 * unit, FAINT)
    canvas.text(HELP, (width - 84 * unit, height - FOOTER / 2 * unit), 17 * unit, FAINT, "midright")
    if session.outcome != "flying":
        banner(canvas, unit, session.result_text(), "R to restart")
    elif session.paused:
        banner(canvas, unit, "paused", "space to resume")
    elif session.countdown > 0:
        banner(canvas, unit, f"ready: {session.countdown:.0f}", "press a key to start")


def banner(canvas: Canvas, unit: float, text: str, below: str) -> None:
    """Write two lines on a card at the bottom centre."""
    from flatgym.rendering.canvas import text_width
    from flatgym.rendering.palette import FAINT, INK, PALE, WHITE

    middle = canvas.size[0] / 2
    wide = max(text_width(text, 30 * unit), text_width(below, 20 * unit)) + 60 * unit
    top, tall = canvas.size[1] - 150 * unit, 84 * unit
    canvas.panel(middle - wide / 2 - 2 * unit, top - 2 * unit, wide + 4 * unit, tall + 4 * unit, PALE, 16 * unit)
    canvas.panel(middle - wide / 2, top, wide, tall, WHITE, 14 * unit)
    canvas.text(text, (middle, top + 30 * unit), 30 * unit, INK, "center")
    canvas.text(below, (middle, top + 60 * unit), 20 * unit, FAINT, "center")
