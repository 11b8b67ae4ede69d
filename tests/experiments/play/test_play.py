"""Manual flight: keys and sticks become actions, commands change the session; scripts act as the user."""

import sys
from itertools import chain, repeat

import gymnasium as gym
import numpy as np
import pytest
from typer.testing import CliRunner

from experiments.cli import app
from experiments.play import window as module
from experiments.play.session import (
    COMMANDS,
    COUNTDOWN,
    LIFT_AXIS,
    RATE_AXIS,
    TRIGGER_AXIS,
    Controls,
    Session,
    stick_action,
)
from experiments.play.window import frames, handle, play
from flatgym import SCENARIOS
from flatgym.rendering import load_pygame
from flatgym.scenarios.reference import reference

load_pygame()

import pygame  # noqa: E402

HOVER = -0.1
STEP = 0.02


class Autopilot:
    """Controls that play back actions (K, 2), one each step."""

    touched = True

    def __init__(self, actions):
        self.actions = iter(actions)

    def action(self, hover):
        return next(self.actions, np.array([hover, 0.0], dtype=np.float32))


def key(name, down=True):
    """Return the event of a key."""
    code = pygame.key.key_code(name)
    return pygame.event.Event(pygame.KEYDOWN if down else pygame.KEYUP, key=code)


def script(*batches):
    """Return a source of events that hands out one batch a frame, then quits."""
    remaining = chain(batches, repeat([pygame.event.Event(pygame.QUIT)]))
    return lambda: next(remaining)


def fly(session, actions):
    """Fly actions (K, 2) in the session, a frame at a time."""
    autopilot = Autopilot(actions)
    session.countdown = 0.0
    while session.outcome == "flying":
        session.advance(autopilot, 1 / 50)


@pytest.fixture(autouse=True)
def headless(monkeypatch):
    """Invisible windows; the names of keys need pygame's display."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame.display.quit()
    pygame.display.init()
    yield
    pygame.display.quit()


@pytest.mark.parametrize(
    ("held", "action"),
    [
        ((), (HOVER, 0)),
        (("up",), (1, 0)),
        (("down", "right"), (-1, 1)),
        (("left",), (HOVER, -1)),
        (("left", "right", "up", "down"), (HOVER, 0)),
        (("w", "d"), (1, 1)),
        (("up", "w", "space"), (1, 0)),
    ],
)
def test_keys_command_limits_and_cancel(held, action):
    assert Controls(held=set(held)).action(HOVER) == pytest.approx(np.array(action, dtype=np.float32))


def test_a_gamepad_reaches_all_limits_and_hovers_when_released():
    cases = {
        (): (HOVER, 0),
        ((RATE_AXIS, 1.0),): (HOVER, 1),
        ((RATE_AXIS, -1.0), (LIFT_AXIS, -1.0)): (1, -1),
        ((LIFT_AXIS, 1.0),): (-1, 0),
        ((TRIGGER_AXIS, 1.0),): (1, 0),
        ((TRIGGER_AXIS, 1.0), (LIFT_AXIS, 1.0)): (-1, 0),
        ((RATE_AXIS, 0.1), (LIFT_AXIS, -0.1), (TRIGGER_AXIS, 0.05)): (HOVER, 0),
    }
    for axes, action in cases.items():
        assert stick_action(dict(axes), HOVER) == pytest.approx(action)
        assert Controls(axes=dict(axes)).action(HOVER) == pytest.approx(np.array(action, dtype=np.float32))


def test_a_stick_is_monotone_and_has_no_jump():
    deflections = np.linspace(-1, 1, 401)
    actions = np.array([stick_action({RATE_AXIS: x, LIFT_AXIS: -x}, HOVER) for x in deflections])
    assert (np.diff(actions, axis=0) >= 0).all()
    assert np.diff(actions, axis=0).max() < 0.01


def test_gamepad_events_are_handled():
    session, controls = Session("hoop"), Controls()
    handle(
        session, controls, pygame.event.Event(pygame.CONTROLLERAXISMOTION, axis=RATE_AXIS, value=-32768, instance_id=0)
    )
    assert controls.touched
    assert controls.action(HOVER) == pytest.approx([HOVER, -1])
    start = pygame.event.Event(pygame.CONTROLLERBUTTONDOWN, button=pygame.CONTROLLER_BUTTON_START, instance_id=0)
    handle(session, controls, start)
    assert session.paused


@pytest.mark.parametrize("speed", [0.1, 0.25, 1.0, 2.0])
def test_a_session_matches_the_environment_at_any_speed(speed):
    session = Session("hoop", speed)
    fly(session, reference("hoop").actions)
    assert (session.outcome, session.steps, session.best_steps) == ("goal", 70, 70)
    assert session.result_text() == "goal in 70 steps; K* is 70, the gap +0.0%"
    assert np.allclose(session.instant.states, session.ghost, atol=1e-9)


def test_within_a_step_the_exact_arc_is_shown():
    session = Session("hoop", speed=0.25)
    autopilot = Autopilot(reference("hoop").actions)
    session.countdown = 0.0
    session.advance(autopilot, 5.5 * STEP / 0.25)
    instant, quadrotor = session.instant, SCENARIOS["hoop"].quadrotor
    control = quadrotor.control(reference("hoop").actions[5])
    assert instant.part == pytest.approx(0.5)
    assert instant.states.shape == (7, 5)
    assert np.allclose(instant.states[-1], quadrotor.step(instant.states[-2], control, STEP / 2), atol=1e-12)


def test_without_input_it_hovers_until_the_time_limit():
    session = Session("hoop", speed=1.0)
    last = [canvas for canvas, _ in zip(frames(session, list), range(int(50 * (COUNTDOWN + 5)) + 9), strict=False)][-1]
    assert last.pixels().std() > 5
    assert (session.outcome, session.steps) == ("time-limit", 250)
    assert np.abs(session.instant.states - SCENARIOS["hoop"].start_state).max() < 1e-3
    assert session.result_text() == "time-limit after 250 steps"
    assert session.best_steps == 0


def test_keys_fly():
    session = Session("hoop", speed=1.0)
    batches = [[key("up"), key("right")], [], [], [key("right", down=False)], *[[]] * 20]
    assert len(list(frames(session, script(*batches)))) == len(batches)
    states = session.instant.states
    assert session.over
    assert (states[-1, 0:2] > 0.3).all()
    assert states[-1, 4] == pytest.approx(2 * STEP * 10)


def test_the_flight_waits_for_the_controls_or_the_countdown():
    session, nothing = Session("hoop", speed=1.0), Controls()
    for _ in range(100):
        session.advance(nothing, 1 / 50)
    assert session.steps == 0
    for _ in range(100):
        session.advance(nothing, 1 / 50)
    assert session.steps > 0


def test_restart_pause_ghost_and_speed():
    session = Session("hoop", speed=1.0)
    seen = frames(
        session,
        script([key("up")], [], [], [key("space")], [], [], [key("space")], [], [key("r")], [key("g")], [key("[")]),
    )
    steps = [session.steps for _ in seen]
    assert steps == [0, 1, 2, 2, 2, 2, 3, 4, 0, 1, 2]
    assert session.show_ghost is False
    assert session.speed == pytest.approx(0.8)
    assert session.flights == 2


def test_speed_has_limits_on_the_keys_too():
    session = Session("hoop")
    for word, limit in (("faster", 2.0), ("slower", 0.05)):
        for _ in range(50):
            session.command(word)
        assert session.speed == limit


def test_two_keys_and_the_window_quit():
    for end in (key("q"), key("escape"), pygame.event.Event(pygame.WINDOWCLOSE)):
        session = Session("hoop")
        assert len(list(frames(session, script([], [end], [])))) == 1
        assert session.over


def test_losing_the_focus_releases_all_keys():
    controls = Controls(held={"up"})
    handle(Session("hoop"), controls, pygame.event.Event(pygame.WINDOWFOCUSLOST))
    assert not controls.touched


def test_the_fewest_steps_of_a_session_are_remembered():
    session = Session("horizontal-3", speed=1.0)
    hovering = np.array([[session.hover, 0.0]] * 3, dtype=np.float32)
    best = reference("horizontal-3").actions
    fly(session, np.concatenate([hovering, best]))
    assert session.best_steps == 47
    session.restart()
    fly(session, best)
    assert session.best_steps == 44
    session.restart()
    fly(session, np.concatenate([hovering, best]))
    assert session.best_steps == 44


def test_a_distribution_gives_a_new_scenario_for_each_flight():
    session = Session("random-goal", speed=1.0)
    assert session.ghost is None
    first = session.scenario
    pictures = [canvas.pixels().copy() for canvas in frames(session, script([key("up")], [], [key("r")], []))]
    assert session.scenario != first
    assert (pictures[0] != pictures[-1]).any()


def test_every_command_changes_the_session():
    for word in set(COMMANDS.values()):
        session = Session("hoop")
        before = dict(vars(session))
        session.command(word)
        assert any(vars(session)[name] is not value for name, value in before.items())


def test_a_flight_in_a_window_is_recorded(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "FRAMES_PER_SECOND", 1000)
    pushed = iter([[key("up")], [], [key("space")], [], [key("q")]])

    class Clockwork(module.Window):
        def show(self, canvas):
            super().show(canvas)
            for event in next(pushed):
                pygame.event.post(event)

    monkeypatch.setattr(module, "Window", Clockwork)
    session = play("hoop", speed=1.0, video=tmp_path / "flight.gif")
    assert session.over
    assert session.paused
    assert (tmp_path / "flight.gif").stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["hop"], "did you mean 'hoop'"),
        (["hoop", "--speed", "9"], "speed must lie in 0.05..2.0, got 9"),
        (["hoop", "--video", "flight.avi"], "unknown ending '.avi'"),
    ],
)
def test_bad_arguments_exit_2_with_the_way_out(monkeypatch, capsys, arguments, words):
    monkeypatch.setattr(sys, "argv", ["flatquad", "play", *arguments])
    with pytest.raises(SystemExit) as end:
        app.main()
    assert end.value.code == 2
    assert words in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("options", [[], ["--video", "flight.gif"]])
def test_without_a_display_it_says_so_and_ends(monkeypatch, capsys, tmp_path, options):
    for variable in ("SDL_VIDEODRIVER", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["flatquad", "play", "hoop", *options])
    pygame.display.quit()
    with pytest.raises(SystemExit) as end:
        app.main()
    assert end.value.code == 1
    assert "failed: no display was found to fly on" in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


def test_help_has_an_example():
    result = CliRunner().invoke(app.app, ["play", "--help"])
    assert result.exit_code == 0
    assert "flatquad play hoop" in result.output


def test_hover_balances_gravity():
    session = Session("hoop")
    env = gym.make("FlatQuad-v0", scenario="hoop")
    env.reset(seed=0)
    *_, info = env.step(np.array([session.hover, 0.0], dtype=np.float32))
    assert np.abs(info["state"]).max() < 1e-6
