"""Turns on single segments: the guess turns one segment only, and the local search finds what the starts miss."""

import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Scenario
from optimal.direct import segment_turns
from optimal.direct.guesses import turned_guess, warm_start
from optimal.direct.multistart import search
from optimal.direct.segment_turns import search_segment_turns
from optimal.direct.shooting import solve_coarse
from optimal.direct.stages import Stages
from optimal.flights.certificate import certify

GAPS = tuple(Hoop(2.5 * (i + 1), 1.5 * (-1) ** i, 0.5) for i in range(6))
SLALOM = Scenario("slalom-6", (0, 0), (17.5, 0), hoops=GAPS, time_limit=30)


def mirrored(scenario):
    """Return a scenario mirrored in the vertical axis."""
    hoops = tuple(Hoop(-hoop.x, hoop.z, hoop.diameter, np.pi - hoop.angle) for hoop in scenario.hoops)
    (x, z), (goal_x, goal_z) = scenario.start, scenario.goal
    return Scenario("mirrored", (-x, z), (-goal_x, goal_z), hoops=hoops, time_limit=scenario.time_limit)


@pytest.fixture(scope="module")
def slalom():
    return solve_coarse(SCENARIOS["slalom"])


@pytest.mark.parametrize("phase", range(4))
def test_a_turn_changes_the_tilt_of_one_segment(slalom, phase):
    stages = Stages(slalom.steps)
    plain = warm_start(slalom.trajectory, slalom.steps)[stages.states]
    turned = turned_guess(slalom.trajectory, slalom.steps, phase, -1)[stages.states] - plain
    first, last = stages.firsts[phase], stages.firsts[phase] + slalom.steps[phase]
    np.testing.assert_array_equal(turned[:, :4], 0.0)
    np.testing.assert_allclose(turned[: first + 1, 4], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.diff(turned[first : last + 1, 4]), -2 * np.pi / slalom.steps[phase])
    np.testing.assert_allclose(turned[last:, 4], -2 * np.pi)
    opposite = turned_guess(slalom.trajectory, slalom.steps, phase, 1)[stages.states] - plain
    np.testing.assert_allclose(opposite, -turned, atol=1e-12)


def test_the_search_ends_where_no_turn_on_one_segment_is_faster(slalom):
    found = search_segment_turns(SCENARIOS["slalom"], [slalom], lambda _: True)
    fastest = min((shot for shot in [slalom, *found] if shot.converged), key=lambda shot: shot.trajectory.duration)
    assert fastest.trajectory.duration < slalom.trajectory.duration * 0.97
    again = search_segment_turns(SCENARIOS["slalom"], [fastest], lambda _: True, breadth=1)
    assert len(again) == 2 * len(fastest.steps) + 1
    assert min(shot.trajectory.duration for shot in again if shot.converged) > fastest.trajectory.duration * (1 - 1e-5)
    # The last start takes only passing times and tilts of the flight, and leads back to it.
    assert again[-1].trajectory.duration == pytest.approx(fastest.trajectory.duration, rel=1e-4)


def test_turns_far_apart_do_not_interact(monkeypatch):
    start = solve_coarse(SCENARIOS["ladder"])
    found = search_segment_turns(SCENARIOS["ladder"], [start], lambda _: True)
    monkeypatch.setattr(segment_turns, "REACH", len(start.steps))
    every = search_segment_turns(SCENARIOS["ladder"], [start], lambda _: True)
    assert len(found) < len(every)
    fastest, known = (min(shot.trajectory.duration for shot in shots if shot.converged) for shots in (found, every))
    assert fastest == pytest.approx(known, rel=1e-5)


def test_only_allowed_windings_are_searched(slalom):
    found = search_segment_turns(SCENARIOS["slalom"], [slalom], lambda winding: winding in (0, 1))
    assert {shot.winding for shot in found} <= {0, 1}
    assert search_segment_turns(SCENARIOS["slalom"], [slalom], lambda winding: winding == 0, breadth=1)[:-1] == []


def test_starts_that_did_not_converge_are_ignored():
    shot = solve_coarse(Scenario("far", (0, 0), (4000, 0)))
    assert search_segment_turns(Scenario("far", (0, 0), (4000, 0)), [shot], lambda _: True) == []


def test_the_search_beats_all_random_starts_on_a_slalom_of_six_hoops():
    # Three starts of each winding up to three find 5.53357 s.
    fastest = search(SLALOM, starts=1).shots[0]
    assert fastest.trajectory.duration < 5.5184
    assert certify(fastest.trajectory, SLALOM).holds()


@pytest.mark.parametrize("name", ["slalom", "loop"])
def test_mirrored_tracks_take_the_same_time(name):
    right, left = search(SCENARIOS[name], starts=1).shots[0], search(mirrored(SCENARIOS[name]), starts=1).shots[0]
    assert right.trajectory.duration == pytest.approx(left.trajectory.duration, rel=1e-5)
    assert right.winding == -left.winding
