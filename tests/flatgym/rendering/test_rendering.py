"""Pictures: they show the episode, are functions of it, and need no display."""

import subprocess
import sys
from dataclasses import replace
from functools import cache
from itertools import pairwise

import imageio.v2 as imageio
import imageio_ffmpeg
import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Scenario
from flatgym.rendering import Renderer, check_ghost, load_pygame, write_video
from flatgym.rendering.instant import Instant, between, box_of_interest
from flatgym.scenarios.reference import ghost_states, reference
from flatgym.task.rollout import fly_actions

load_pygame()

import pygame  # noqa: E402

from flatgym.rendering import palette, picture  # noqa: E402
from flatgym.rendering.canvas import Camera, ramp  # noqa: E402

SIZE = (320, 240)


def flight(name, steps=None):
    """Return states, thrusts and hoops passed of the first steps of the best flight known."""
    thrusts = SCENARIOS[name].quadrotor.control(reference(name).actions)[:steps, 0]
    return ghost_states(name)[: len(thrusts) + 1], thrusts, hoops_passed(name)[len(thrusts)]


@cache
def hoops_passed(name):
    return [int(episode.hoops_passed[0]) for episode in fly_actions(SCENARIOS[name], reference(name).actions)]


def drawn(name, steps=None, *, size=SIZE, outcome="flying", **options):
    return Renderer(SCENARIOS[name], "rgb_array", size=size, **options).draw(*flight(name, steps), outcome)


def near(pixels, colour, within=40):
    """Return how many pixels look like a colour."""
    return int((np.abs(pixels.astype(int) - colour).sum(axis=-1) < within).sum())


def read_video(path):
    """Return the frames of a file."""
    if path.suffix == ".gif":
        return [frame[..., :3] for frame in imageio.mimread(path)]
    # imageio's own reader leaves pipes open.
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    flat = subprocess.run(command, capture_output=True, check=True).stdout
    return list(np.frombuffer(flat, dtype=np.uint8).reshape(-1, SIZE[1], SIZE[0], 3))


@pytest.fixture
def headless(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame.display.quit()
    yield
    pygame.display.quit()


@pytest.mark.parametrize("size", [(320, 240), (641, 357), (64, 64)])
def test_pictures_have_the_requested_size(size):
    pixels = drawn("hoop", 20, size=size)
    assert pixels.shape == (size[1], size[0], 3)
    assert pixels.dtype == np.uint8


@pytest.mark.parametrize("name", ["ground-6", "drop", "loop"])
def test_the_same_episode_gives_the_same_picture(name):
    renderer = Renderer(SCENARIOS[name], size=SIZE, ghost=ghost_states(name))
    flown = flight(name)
    first = renderer.draw(*flown, "goal")
    renderer.draw(*flight(name, 10), "flying")
    renderer.draw(flown[0] + np.array([40.0, -30.0, 0, 0, 0]), *flown[1:], "flying")
    assert np.array_equal(renderer.draw(*flown, "goal"), first)
    assert np.array_equal(drawn(name, outcome="goal", ghost=ghost_states(name)), first)


def test_returned_pictures_do_not_change():
    renderer = Renderer(SCENARIOS["hoop"], size=SIZE)
    first = renderer.draw(*flight("hoop", 10))
    kept = first.copy()
    renderer.draw(*flight("hoop", 60))
    assert np.array_equal(first, kept)


def test_rendering_survives_pygame_quit():
    before = drawn("hoop", 10)
    pygame.quit()
    after = drawn("hoop", 11)
    assert np.array_equal(drawn("hoop", 10), before)
    assert (after != before).any()


def test_every_step_changes_the_picture():
    renderer = Renderer(SCENARIOS["climb"], size=SIZE)
    pictures = [renderer.draw(*flight("climb", steps)) for steps in (0, 1, 20, 21, 64)]
    assert all((a != b).any() for a, b in pairwise(pictures))


def test_a_ghost_is_drawn_at_its_state():
    alone, beside = drawn("diagonal", 35), drawn("diagonal", 35, ghost=ghost_states("diagonal") + np.eye(5)[1])
    assert (alone != beside).any(axis=-1).mean() > 0.01


def test_a_ghost_waits_at_its_end():
    states = ghost_states("hoop")
    assert np.array_equal(between(states, 1000), states[-1])
    assert np.array_equal(between(states, 3), states[3])
    assert np.allclose(between(states, 3.5), (states[3] + states[4]) / 2)


def test_colours_distinguish_passed_next_and_later_hoops():
    states, thrusts, _ = flight("slalom", 3)
    renderer = Renderer(SCENARIOS["slalom"], size=(960, 720))
    counts = [
        [near(renderer.draw(states, thrusts, n), colour) for n in range(4)] for colour in (palette.NEXT, palette.PASSED)
    ]
    following, passed = np.array(counts)
    assert (following[:3] > 300).all()
    assert following[3] == 0
    assert (np.diff(passed) > 200).all()


def test_a_mirrored_episode_gives_a_mirrored_picture():
    scenario = Scenario("valley", (-3.0, 0.0), (3.0, 0.0))
    states, thrusts, _ = flight("horizontal-6", 30)
    states = states - [3, 0, 0, 0, 0]
    mirrored = replace(scenario, start=scenario.goal, goal=scenario.start)
    size = (640, 480)
    one = Renderer(scenario, size=size).draw(states, thrusts)
    other = Renderer(mirrored, size=size).draw(states * [-1, 1, -1, 1, -1], thrusts)
    strong = [
        (np.abs(pixels.astype(int) - palette.PAPER).sum(axis=-1) > 150)[70:430, 30:-30] for pixels in (one, other)
    ]
    assert strong[0].sum() > 1000
    assert (strong[0] != strong[1][:, ::-1]).sum() < 0.25 * strong[0].sum()


def test_the_path_is_coloured_by_thrust():
    states, _, _ = flight("horizontal-9", 50)
    renderer = Renderer(SCENARIOS["horizontal-9"], size=(640, 480))
    for thrust, share in ((1.0, 0.0), (20.0, 1.0)):
        pixels = renderer.draw(states, np.full(50, thrust), 0, "time-limit")[60:450]
        assert near(pixels, ramp(share), 20) > 300
        assert near(pixels, ramp(1 - share), 20) == 0


def test_the_ramp_rises_in_lightness():
    lightness = [np.dot(ramp(share), (0.2126, 0.7152, 0.0722)) for share in np.linspace(0, 1, 30)]
    assert (np.diff(lightness) > 0).all()
    assert ramp(-1) == ramp(0)
    assert ramp(2) == ramp(1)


@pytest.mark.parametrize("name", list(SCENARIOS))
def test_the_camera_sees_everything(name):
    scenario = SCENARIOS[name]
    view = picture.Picture(scenario, SIZE, None, None)
    states = ghost_states(name) * [3, 3, 1, 1, 1]
    left, top, width, height = view.view
    rims = [hoop.centre + side * hoop.diameter / 2 * hoop.across for hoop in scenario.hoops for side in (-1, 1)]
    for seen in (states[:1], states):
        places = view.camera(seen)(np.array([scenario.start, scenario.goal, *rims, *seen[:, 0:2]]))
        assert (places >= (left, top)).all()
        assert (places <= (left + width, top + height)).all()


def test_the_camera_is_fixed_while_the_vehicle_is_in_view():
    view = picture.Picture(SCENARIOS["hoop"], SIZE, None, ghost_states("hoop"))
    cameras = {view.camera(ghost_states("hoop")[:k]) for k in range(1, 72)}
    assert len(cameras) == 1


def test_a_fitted_camera_shows_its_box():
    camera = Camera.fit(np.array([-1.0, -2.0, 3.0, 2.0]), (10.0, 20.0, 220.0, 120.0), 10.0, 1e3)
    low_x, low_z, high_x, high_z = camera.seen
    assert np.allclose(camera((low_x, high_z)), (10, 20))
    assert np.allclose(camera((high_x, low_z)), (230, 140))
    assert camera.scale == 25
    assert np.allclose(camera((1.0, 2.0)), (120, 30))


def test_floor_and_ceiling_are_drawn():
    scenario = replace(SCENARIOS["ground-6"], ceiling=1.5)
    box = box_of_interest(scenario, None)
    assert box[1] < 0
    assert box[3] > 1.5
    states, thrusts, _ = flight("ground-6", 5)
    counts = [
        near(Renderer(s, size=SIZE).draw(states, thrusts), palette.BAND, 8)
        for s in (replace(scenario, floor=None, ceiling=None), replace(scenario, ceiling=None), scenario)
    ]
    assert 5 * counts[0] < counts[1]
    assert counts[2] > 1.3 * counts[1]


@pytest.mark.parametrize(
    "scenario",
    [
        Scenario("far", (0.0, 0.0), (900.0, -400.0), time_limit=60.0),
        Scenario("near", (0.0, 0.0), (0.11, 0.0)),
        Scenario("very far", (-1e6, 0.0), (1e6, 1e6), floor=-1e6, ceiling=1e6),
        Scenario("tight", (0.0, 1.0), (1.0, 1.0), hoops=(Hoop(0.5, 1.0, 1e-3),), floor=1.0, ceiling=1.0 + 1e-9),
    ],
    ids=lambda scenario: scenario.name,
)
def test_any_scenario_can_be_drawn(scenario):
    pixels = Renderer(scenario, size=SIZE).draw(scenario.start_state[None], [])
    assert pixels.std() > 5


def test_states_between_steps_are_interpolated():
    states, thrusts, _ = flight("hoop", 30)
    view = picture.Picture(SCENARIOS["hoop"], SIZE, 70, ghost_states("hoop"))
    whole, part = (view.pixels(Instant(states, thrusts, part=part)) for part in (1.0, 0.5))
    assert (whole != part).any()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mode": "ascii"}, "unknown render_mode 'ascii'; known: human, rgb_array"),
        ({"size": (10, 600)}, r"at least 64 px, got \(10, 600\)"),
        ({"ghost": np.zeros((4, 3))}, r"shape \(K\+1, 5\), got shape \(4, 3\)"),
        ({"ghost": np.full((4, 5), np.nan)}, "must be finite"),
    ],
)
def test_invalid_arguments_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        Renderer(SCENARIOS["hoop"], **options)


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setattr("flatgym.extras.find_spec", lambda _: None)
    with pytest.raises(ImportError, match=r"pip install 'flatgym\[render\]'"):
        Renderer(SCENARIOS["hoop"])
    with pytest.raises(ImportError, match=r"pip install 'flatgym\[render\]'"):
        write_video("flight.gif", [])


def test_ghosts_are_checked():
    assert check_ghost([[0, 0, 0, 0, 0]]).dtype == np.float64


@pytest.mark.usefixtures("headless")
def test_a_window_shows_the_episode_until_it_is_closed():
    scenario = SCENARIOS["horizontal-3"]
    renderer, other = (Renderer(scenario, "human", size=SIZE) for _ in range(2))
    states, thrusts, _ = flight("horizontal-3", 3)
    assert renderer.draw(states, thrusts) is None
    assert renderer.is_open
    pygame.event.post(pygame.event.Event(pygame.WINDOWCLOSE, window=renderer._window._window))
    other.draw(states, thrusts)
    renderer.draw(states, thrusts)
    assert (renderer.is_open, other.is_open) == (False, True)
    assert renderer.draw(states, thrusts) is None
    renderer.close()
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    other.draw(states, thrusts)
    assert not other.is_open


@pytest.mark.usefixtures("headless")
def test_a_window_runs_in_real_time():
    renderer = Renderer(replace(SCENARIOS["hoop"], dt=0.05), "human", size=SIZE)
    begin = pygame.time.get_ticks()
    for _ in range(5):
        renderer.draw(*flight("hoop", 3))
    assert pygame.time.get_ticks() - begin >= 4 * 48
    renderer.close()


def test_without_a_display_the_error_names_the_alternatives(monkeypatch):
    pygame.display.quit()
    monkeypatch.setenv("SDL_VIDEODRIVER", "nothing")
    with pytest.raises(OSError, match=r"no window can be opened .* use rgb_array"):
        Renderer(SCENARIOS["hoop"], "human")


def test_environments_import_without_pygame():
    code = (
        "import sys, flatgym.envs.env, flatgym.rendering, flatgym.scenarios.reference, flatgym.rendering.instant; "
        "sys.exit(any(name in sys.modules for name in ('pygame', 'imageio')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("ending", ["mp4", "gif"])
def test_videos_hold_every_frame(tmp_path, ending):
    renderer = Renderer(SCENARIOS["hoop"], size=SIZE)
    frames = [renderer.draw(*flight("hoop", steps)) for steps in range(0, 24, 2)]
    path = write_video(tmp_path / "deep" / f"flight.{ending}", iter(frames), fps=25)
    read = read_video(path)
    assert len(read) == len(frames)
    assert read[0].shape == frames[0].shape
    assert np.abs(read[-1].astype(int) - frames[-1]).mean() < 6
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_videos_are_written_atomically(tmp_path):
    def broken():
        yield np.zeros((64, 64, 3), dtype=np.uint8)
        raise RuntimeError("lost")

    for frames, error in ((broken(), RuntimeError), ([], ValueError)):
        with pytest.raises(error):
            write_video(tmp_path / "flight.gif", frames)
        assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match=r"unknown ending '\.avi' of flight\.avi; known: \.mp4, \.gif"):
        write_video(tmp_path / "flight.avi", [])
