"""What all tests share: random states and controls, the paper's vehicle, a browser, a stand-in for moviepy."""

import os
import sys
from types import ModuleType

import numpy as np
import pytest

from flatgym import Quadrotor
from tests.browser import MISSING, find

os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
"""JAX compiles for a few steps only: half the time goes without optimisation."""


@pytest.fixture
def generator() -> np.random.Generator:
    """A generator with a fixed seed."""
    return np.random.default_rng(7)


@pytest.fixture
def quadrotor() -> Quadrotor:
    """The paper's vehicle."""
    return Quadrotor()


class ImageSequenceClip:
    """The part of moviepy's class that the video wrappers of Gymnasium and Stable-Baselines3 call."""

    def __init__(self, sequence, fps):
        self.frames, self.fps = np.array(sequence), fps

    def write_videofile(self, filename, **_):
        import imageio.v3 as imageio

        imageio.imwrite(filename.replace(".mp4", ".gif"), self.frames, duration=1000 / self.fps)


@pytest.fixture
def moviepy(monkeypatch):
    """A substitute for moviepy, which conflicts with the pillow version of Minari; it writes through imageio."""
    names = ["moviepy", "moviepy.video", "moviepy.video.io", "moviepy.video.io.ImageSequenceClip"]
    for name in names:
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    sys.modules[names[-1]].ImageSequenceClip = ImageSequenceClip


@pytest.fixture(scope="session")
def chromium() -> str:
    """The path of a Chromium; a test without one fails and says how to get it."""
    try:
        path = find()
    except ValueError as error:
        pytest.fail(str(error))
    return path or pytest.fail(MISSING)


@pytest.fixture(scope="session")
def browser(chromium):
    """One browser for all tests: Playwright's synchronous interface can be started only once in a process."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=chromium)
        yield running
        running.close()
