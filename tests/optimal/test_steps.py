"""K*: flown in both environments to the goal at exactly K steps, and no fewer by any wider search here."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Tolerance
from flatgym.vector import FlatQuadVectorEnv
from optimal import SolveFailed, Status, fewest_steps

FOUND = {"horizontal-3": 44, "horizontal-6": 61, "horizontal-15": 94, "diagonal": 70}
"""Orientation from an independent search with a square tolerance; the round one may cost one step more."""


@pytest.mark.parametrize("name", ["horizontal-6", "hoop", "ground-6", "climb", "slalom"])
def test_actions_replay_to_the_goal_at_exactly_k_steps(name):
    result = fewest_steps(name)
    assert result.actions.dtype == np.float32
    assert result.actions.shape == (result.steps, 2)
    assert result.lower_bound <= result.steps
    assert not result.proven
    assert result.tolerance_used < 1
    env, envs = gym.make("FlatQuad-v0", scenario=name), FlatQuadVectorEnv(2, scenario=name)
    env.reset()
    envs.reset()
    for k, action in enumerate(result.actions, start=1):
        _, _, terminated, truncated, info = env.step(action)
        batch = envs.step(np.stack([action, action]))
        assert (terminated, truncated) == (k == result.steps, False)
        np.testing.assert_allclose(info["state"], result.states[k], atol=1e-12)
        np.testing.assert_array_equal(batch[2], [terminated] * 2)
    assert info["is_success"]
    assert info["hoops_passed"] == len(SCENARIOS[name].hoops)


@pytest.mark.parametrize(("name", "steps"), FOUND.items())
def test_k_agrees_with_an_independent_search(name, steps):
    assert fewest_steps(name, windings=(0,)).steps in (steps, steps + 1)


def test_k_shrinks_with_the_tolerance_and_grows_with_the_way():
    scenario = SCENARIOS["horizontal-3"]
    tight, loose = (
        fewest_steps(replace(scenario, tolerance=Tolerance(p, 2 * p, p)), windings=(0,)).steps for p in (0.02, 0.3)
    )
    usual = fewest_steps(scenario, windings=(0,)).steps
    assert loose < usual < tight
    assert fewest_steps("horizontal-6", windings=(0,)).steps > usual


def test_finer_steps_are_no_slower():
    scenario = SCENARIOS["horizontal-3"]
    coarse = fewest_steps(replace(scenario, dt=0.04), windings=(0,))
    fine = fewest_steps(replace(scenario, dt=0.02), windings=(0,))
    assert fine.steps * 0.02 <= coarse.steps * 0.04


def test_no_flight_within_the_time_limit_is_said_not_guessed():
    hurried = replace(SCENARIOS["horizontal-6"], time_limit=1.1)
    with pytest.raises(SolveFailed, match=r"no flight was found.*takes 1.202 s of 1.1 s") as failure:
        fewest_steps(hurried, windings=(0,))
    assert failure.value.problem == hurried
    result = fewest_steps(hurried, windings=(0,), throw=False)
    assert result.steps == math.inf
    assert result.actions.shape == (0, 2)


def test_hoops_close_together_are_crossed_within_their_steps():
    scenario = replace(SCENARIOS["hoop"], hoops=(Hoop(2.4, 2.4, 0.5), Hoop(2.5, 2.5, 0.5)))
    result = fewest_steps(scenario, windings=(0,))
    assert result.steps >= fewest_steps("diagonal", windings=(0,)).steps


def test_a_time_limit_below_the_bound_is_shown_to_be_impossible():
    hurried = replace(SCENARIOS["horizontal-6"], time_limit=1.0)
    result = fewest_steps(hurried, windings=(0,), throw=False)
    assert result.status is Status.INFEASIBLE
    assert "at least 54 steps of 0.02 s, and time_limit = 1.0 s allows 50" in result.reason
