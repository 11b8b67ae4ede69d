"""What all tests share: random states and controls, the paper's vehicle, a browser."""

import numpy as np
import pytest

from flatgym import Quadrotor
from tests.browser import MISSING, find


@pytest.fixture
def generator() -> np.random.Generator:
    """A generator with a fixed seed."""
    return np.random.default_rng(7)


@pytest.fixture
def quadrotor() -> Quadrotor:
    """The paper's vehicle."""
    return Quadrotor()


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
