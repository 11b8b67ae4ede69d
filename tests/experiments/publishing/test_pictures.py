"""The animations show the flights that their captions state, frame by frame."""

from itertools import pairwise

import numpy as np
import pytest
from PIL import Image

from experiments.files import PUBLISHED, published
from experiments.publishing.figures import pictures
from experiments.publishing.figures.pictures import (
    AGENT,
    BEST,
    FRAME_TIME,
    LAST_FRAME_TIME,
    SIZE,
    agent_cell,
    animate,
    caption,
    captions,
    frames,
)
from flatgym.scenarios.reference import reference

SMALL = (160, 120)


@pytest.fixture(scope="module")
def start():
    """The frames of the first three steps of a flight."""
    return list(frames("loop", reference("loop").actions[:3], ghost=True))


def test_there_is_a_frame_before_the_first_step_and_after_each(start):
    assert len(start) == 4
    assert all(pixels.shape == (720, 960, 3) for pixels in start)
    assert all((a != b).any() for a, b in pairwise(start))


def test_an_animation_holds_every_frame_and_the_last_one_longer(start, tmp_path):
    animate(tmp_path / "a" / "loop.gif", start, SMALL)
    with Image.open(tmp_path / "a" / "loop.gif") as gif:
        assert (gif.n_frames, gif.size, gif.info["loop"]) == (4, SMALL, 0)
        for i, pixels in enumerate(start):
            gif.seek(i)
            assert gif.info["duration"] == (LAST_FRAME_TIME if i == 3 else FRAME_TIME)
            wanted = Image.fromarray(pixels).resize(SMALL, Image.Resampling.LANCZOS)
            difference = np.asarray(gif.convert("RGB"), dtype=float) - np.asarray(wanted)
            assert np.abs(difference).mean() < 3
    assert list((tmp_path / "a").iterdir()) == [tmp_path / "a" / "loop.gif"]


def test_the_same_flight_gives_the_same_animation(start, tmp_path):
    for name in ("a.gif", "b.gif"):
        animate(tmp_path / name, start, SMALL)
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()


def test_both_animations_are_drawn_from_the_results(monkeypatch, tmp_path):
    drawn = {}
    monkeypatch.setattr(pictures, "frames", lambda name, actions, ghost=False: (name, len(actions), ghost))
    monkeypatch.setattr(pictures, "animate", lambda path, flight: drawn.update({path.name: flight}))
    benchmark = published("benchmark.json")
    pictures.animations(tmp_path, benchmark)
    steps = len(agent_cell(benchmark)["actions"])
    assert drawn == {f"{AGENT}.gif": (AGENT, steps, True), f"{BEST}.gif": (BEST, reference(BEST).k_star, False)}


def test_captions_state_the_steps_of_the_animations():
    benchmark = published("benchmark.json")
    text = captions(benchmark)
    for name, steps in {AGENT: len(agent_cell(benchmark)["actions"]), BEST: reference(BEST).k_star}.items():
        assert f"in {steps} steps" in text
        with Image.open(PUBLISHED / f"{name}.gif") as gif:
            assert (gif.n_frames, gif.size) == (steps + 1, SIZE)
        assert (PUBLISHED / f"{name}.gif").stat().st_size < 1_500_000
    assert f"in {len(agent_cell(benchmark)['actions'])} steps" in caption(benchmark)
