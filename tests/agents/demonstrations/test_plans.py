"""Plans: start states, seeds, and problems that cannot be flown."""

import numpy as np
import pytest

from agents import demonstrations
from agents.demonstrations.plans import START_SPREAD
from flatgym import Distribution, Scenario
from optimal import SolveFailed


def test_the_first_flight_has_the_scenarios_start_and_the_others_displaced_starts(grounded):
    own, near, *continued = grounded
    assert own.options is None
    assert own.steps == own.flight.lower_bound == 27
    assert 0 < np.hypot(*(near.options["state"][:2])) <= START_SPREAD
    assert not near.options["state"][2:].any()
    for one in continued:
        assert one.options["state"][2:].all()
        assert one.options["state"][1] >= 0


def test_a_plan_depends_on_the_seed_alone(goals):
    reported = []
    (later,) = demonstrations.plan("random-goal", 1, seed=6, jobs=1, progress=lambda *counts: reported.append(counts))
    assert later.scenario == goals[1].scenario
    np.testing.assert_array_equal(later.flight.actions, goals[1].flight.actions)
    assert reported[-1] == (1, 1)


def test_displaced_starts_stay_near_above_the_floor_and_off_the_goal(generator):
    near_goal = Scenario("near", (0, 0), (0.3, 0.1), floor=0.0)
    for _ in range(300):
        start = np.array(demonstrations.displaced(near_goal, generator, 0.4).start)
        assert np.hypot(*start) <= 0.4
        assert start[1] >= 0
        assert np.hypot(*(start - near_goal.goal)) > near_goal.tolerance.position


def test_flights_from_displaced_starts_reach_the_goal_in_the_scenario_itself():
    short = Scenario("short", (0, 0), (1, 0), time_limit=0.7)
    flights = demonstrations.plan(short, 4, spread=1.0, jobs=1)
    assert len(flights) == 4
    assert all(one.steps <= 35 for one in flights)
    with pytest.raises(ValueError, match="all flights of 'short' are equal"):
        demonstrations.plan(short, 1, spread=0.0, own_start=False)


def test_problems_without_a_flight_raise_solve_failed():
    with pytest.raises(SolveFailed, match="at least"):
        demonstrations.plan(Scenario("far", (0, 0), (200, 0)), 3, jobs=1)
    with pytest.raises(SolveFailed):
        demonstrations.plan(Distribution("short", time_limit=0.1, half_width=2.0, least_distance=1.0), 1, jobs=1)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("hop", 1), "unknown scenario 'hop'"),
        (("hoop", 0), "episodes must be a whole number in 1"),
        (("hoop", 1, -1), "seed must be a whole number in 0"),
        (("hoop", 2, 0, 0.0), "all flights of 'hoop' are equal; use one flight, or a larger spread"),
        (("hoop", 3, 0, 100.0), r"spread must be at most 5 m, got 100: starts further away .* bounds of 'hoop'"),
        (("random-goal", 1, 0, 5.1), r"spread must be at most 5 m, got 5.1: .* bounds of 'random-goal'"),
        (("hoop", 2, 0, -1.0), r"plan.spread must be at least 0, got -1.0"),
        (("hoop", 2, 0, None, -1), "perturbed must be a whole number in 0"),
    ],
)
def test_wrong_arguments_are_refused(arguments, words):
    names = ("problem", "episodes", "seed", "spread", "perturbed")
    with pytest.raises(ValueError, match=words):
        demonstrations.plan(**dict(zip(names, arguments, strict=False)))
