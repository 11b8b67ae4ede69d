"""What all tests share: random states and controls, and a single thread for torch."""

import numpy as np
import pytest

from flatgym import Quadrotor


@pytest.fixture
def generator() -> np.random.Generator:
    """A generator with a fixed seed."""
    return np.random.default_rng(7)


@pytest.fixture
def quadrotor() -> Quadrotor:
    """The paper's vehicle."""
    return Quadrotor()
