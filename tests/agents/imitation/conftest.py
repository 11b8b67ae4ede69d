"""Flights and expert data that the tests of imitation learning share."""

import pytest

from agents.imitation.oracles import lqr_oracle
from flatgym import DISTRIBUTIONS
from optimal import fewest_steps, fewest_steps_many


@pytest.fixture(scope="session")
def flight():
    """The optimal flight of horizontal-3."""
    return fewest_steps("horizontal-3", windings=(0,), time_budget=0.0)


@pytest.fixture(scope="session")
def data(flight):
    """Labels of eight expert episodes."""
    return lqr_oracle([flight], count=8)(None, 0)


@pytest.fixture(scope="session")
def sampled():
    """A distribution and the optimal flights of its first three scenarios."""
    distribution = DISTRIBUTIONS["random-hoops"]
    return distribution, fewest_steps_many([distribution.scenario(i) for i in range(3)], jobs=1, progress=False)
