"""Backward starts: simulated forwards they reach the goal."""

import numpy as np
import pytest

from agents.training.backward_starts import backward_starts, fly_back
from flatgym import SCENARIOS, task
from flatgym.envs.vector import FlatQuadVectorEnv
from flatgym.task.scene import GOAL, EpisodeState, Scene


def test_zero_time_gives_the_goal(generator):
    state, passed = fly_back(generator, SCENARIOS["hoop"], np.zeros(5))
    np.testing.assert_array_equal(state, np.tile(SCENARIOS["hoop"].goal_state, (5, 1)))
    np.testing.assert_array_equal(passed, 1)


def test_one_held_control_leads_forward_to_the_goal(generator):
    scenario = SCENARIOS["horizontal-6"]
    state, _ = fly_back(generator, scenario, np.full(200, scenario.dt))
    scene = Scene.of([scenario] * 200)
    # Within one step the control changes at most once; the goal tolerance absorbs it.
    reached = np.zeros(200, dtype=bool)
    for rate in (-10.0, 0.0, 10.0):
        for thrust in np.linspace(1, 20, 5):
            start = EpisodeState(state, *[np.zeros(200, dtype=np.int64)] * 3)
            reached |= task.advance(scene, start, np.tile([thrust, rate], (200, 1))).outcome == GOAL
    assert reached.all()


@pytest.mark.parametrize("name", ["ground-6", "hoop", "slalom"])
def test_the_pool_is_mixed_within_bounds_and_seeded(name):
    scenario = SCENARIOS[name]
    starts = backward_starts(scenario, share=0.8, seed=3, size=2000)
    state, passed = starts.state, starts.hoops_passed
    at_start = np.all(state == scenario.start_state, axis=1)
    assert at_start.mean() < 0.7
    assert np.all(passed[at_start] == 0)
    low_x, low_z, high_x, high_z = scenario.bounds
    assert np.all((state[:, 0] >= low_x) & (state[:, 0] <= high_x) & (state[:, 1] >= low_z) & (state[:, 1] <= high_z))
    assert scenario.floor is None or np.all(state[:, 1] >= scenario.floor)
    assert passed.max() == len(scenario.hoops)
    again = backward_starts(scenario, share=0.8, seed=3, size=2000)
    np.testing.assert_array_equal(state, again.state)
    drawn = FlatQuadVectorEnv(4000, scenario, starts=starts).reset(seed=0)[1]["state"]
    home = np.all(drawn == scenario.start_state, axis=1).mean()
    assert home == pytest.approx(0.2 + 0.8 * at_start.mean(), abs=0.05)


def test_crossed_hoops_are_still_to_be_passed():
    scenario = SCENARIOS["hoop"]
    starts = backward_starts(scenario, near=0.0, size=5000)
    state, passed = starts.state, starts.hoops_passed
    before = passed == 0
    assert before.any()
    # Only states before the line of the hoop can have crossed it backwards.
    behind = (state[:, 0:2] - scenario.hoops[0].centre) @ scenario.hoops[0].direction
    flown = ~np.all(state == scenario.start_state, axis=1)
    assert (behind[before & flown] < 0).mean() > 0.8
