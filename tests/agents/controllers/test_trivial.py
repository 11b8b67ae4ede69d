"""Trivial agents: hovering stands still, random actions fill the box, and neither solves any task."""

import numpy as np
import pytest

from agents import Hover, RandomActions, fly
from flatgym import DISTRIBUTIONS, SCENARIOS, Quadrotor

SEEN = np.zeros((5, 4, 19), dtype=np.float32)


@pytest.mark.parametrize("quadrotor", [Quadrotor(), Quadrotor(thrust_min=2.0, thrust_max=15.0, gravity=3.7)])
def test_hovering_carries_the_weight_without_turning(quadrotor):
    actions, state = Hover(quadrotor).predict(SEEN, state="kept")
    assert (actions.shape, actions.dtype, state) == ((5, 4, 2), np.float32, "kept")
    np.testing.assert_allclose(
        quadrotor.control(actions), np.broadcast_to([quadrotor.gravity, 0.0], actions.shape), atol=1e-5
    )


def test_hovering_stands_still_until_the_time_is_up():
    flights = fly(Hover(), "hoop")
    assert flights.outcomes == ("time-limit",)
    assert np.abs(flights.states[0] - flights.states[0][0]).max() < 1e-3


def test_random_actions_fill_the_box_and_repeat_with_the_seed():
    many = np.zeros((20_000, 19), dtype=np.float32)
    first, same, other = (RandomActions(seed).predict(many)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, same)
    assert not np.array_equal(first, other)
    assert np.abs(first).max() <= 1
    np.testing.assert_allclose(first.mean(axis=0), 0, atol=0.02)
    np.testing.assert_allclose(first.std(axis=0), 1 / np.sqrt(3), atol=0.02)


@pytest.mark.parametrize("name", [*SCENARIOS, *DISTRIBUTIONS])
def test_no_task_is_solved_by_them(name):
    episodes = 20 if name in DISTRIBUTIONS else 3
    for agent in (Hover(), RandomActions()):
        assert "goal" not in fly(agent, name, episodes).outcomes
