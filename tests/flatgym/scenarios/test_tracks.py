"""The named tracks are the figures of racing that their names promise, and so are the best-known flights."""

import numpy as np
import pytest

from flatgym import SCENARIOS
from flatgym.scenarios.reference import ghost_states, reference
from flatgym.scenarios.tracks import TRACKS
from flatgym.task.rollout import fly_actions


def crossings(name):
    """Return the states at the beginning of the steps in which a hoop is passed, shape (hoops, 5)."""
    flown = fly_actions(SCENARIOS[name], reference(name).actions)
    passed = np.array([episode.hoops_passed[0] for episode in flown])
    return ghost_states(name)[np.flatnonzero(np.diff(passed))]


def signed_area(points):
    """Return the area of a polygon, positive when it is passed from +x towards +z."""
    x, z = points.T
    return (x @ np.roll(z, -1) - z @ np.roll(x, -1)) / 2


def test_split_s_is_up_over_and_back_below_inverted_on_the_way():
    upper, lower = SCENARIOS["split-s"].hoops
    assert (upper.x, upper.diameter) == (lower.x, lower.diameter)
    assert upper.z > lower.z
    np.testing.assert_allclose(upper.direction, -lower.direction, atol=1e-15)
    at = crossings("split-s")
    assert at[0, 2] > 0 > at[1, 2]
    assert np.cos(ghost_states("split-s")[:, 4]).min() < -0.9


def test_figure_eight_is_flown_around_two_circles_in_opposite_directions():
    path = ghost_states("figure-eight")[:, 0:2]
    right, left = (signed_area(path[side * path[:, 0] > 0]) for side in (1, -1))
    assert right < -2 < 2 < left


def test_the_ladder_is_climbed_in_switchbacks():
    hoops, at = SCENARIOS["ladder"].hoops, crossings("ladder")
    assert np.all(np.diff([hoop.z for hoop in hoops]) > 0)
    assert np.all(np.diff(at[:, 1]) > 0)
    assert np.sign(at[:, 2]).tolist() == [1, -1, 1, -1]


@pytest.mark.parametrize(("name", "count"), [("slalom", 3), ("slalom-6", 6), ("zigzag-12", 12)])
def test_a_weave_has_hoops_in_equal_spacing_on_alternating_sides(name, count):
    scenario = SCENARIOS[name]
    places = np.array([hoop.centre for hoop in scenario.hoops])
    assert len(places) == count
    np.testing.assert_allclose(np.diff(places[:, 0]), places[0, 0])
    assert np.all(np.diff(np.sign(places[:, 1])) != 0)
    # The straight way from start to goal misses every gap.
    assert all(abs(hoop.z) > hoop.diameter / 2 for hoop in scenario.hoops)


@pytest.mark.parametrize("track", TRACKS, ids=lambda track: track.name)
def test_time_limits_are_round_and_fit_the_best_known_flight(track):
    assert track.time_limit % 5 == 0
    assert 1.7 < track.time_limit / reference(track).time < 3
