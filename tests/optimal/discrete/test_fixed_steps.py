"""Flights in a given number of steps: one step is removed where there is slack, and turning round takes steps."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Scenario
from flatgym.task.rollout import replay_to_goal
from optimal import fewest_steps, solve
from optimal.direct.shooting import WINDINGS, solve_tolerant, solve_winding
from optimal.discrete import program
from optimal.discrete.fewest_steps import search_steps, starting_flights
from optimal.discrete.fixed_steps import MAX_ASSIGNMENTS, MAX_ROUNDS, remove_one_step, separated, solve_in_steps


@pytest.fixture(scope="module")
def zigzag():
    """Flights from rest to rest through twelve hoops."""
    return starting_flights(SCENARIOS["zigzag-12"], WINDINGS)


def one_line(*hoops, goal=(5, 0)):
    """Return a scenario along the x axis."""
    return Scenario("line", (0, 0), goal, hoops=hoops, time_limit=10)


def test_a_flight_with_slack_loses_one_step_after_the_other():
    target, shot = SCENARIOS["hoop"], solve_winding(SCENARIOS["hoop"])
    flight = solve_in_steps(target, shot.trajectory, 0, 73)
    for count in (72, 71):
        flight = remove_one_step(target, flight)
        assert len(flight.actions) == count
        np.testing.assert_array_equal(replay_to_goal(target, flight.actions), flight.states)


def test_the_fewest_steps_cannot_lose_one():
    best = fewest_steps("hoop", time_budget=0.0)
    shot = solve_winding(best.scenario, best.winding)
    flight = solve_in_steps(best.scenario, shot.trajectory, best.winding, best.steps)
    assert remove_one_step(best.scenario, flight) is None


@pytest.mark.parametrize(
    ("second", "apart"),
    [
        (Hoop(2.5, 0, 1), 2),  # twice through one hoop: back in between
        (Hoop(2.4, 0, 1), 2),
        (Hoop(2.6, 0, 1), 0),  # ahead: both in one step
        (Hoop(2.5, 0, 1, math.pi), 1),  # there and back
        (Hoop(2.5, 0, 1, math.pi / 2), 0),
    ],
)
def test_hoops_between_which_a_flight_turns_round_are_steps_apart(second, apart):
    target = one_line(Hoop(2.5, 0, 1), second)
    assert separated(target, np.array([40, 40]), 90) == (40, 40 + apart)
    assert separated(target, np.array([40, 50]), 90) == (40, 50)
    assert separated(target, np.array([95, -1]), 90)[0] == 89


TURNING = {
    "back": one_line(Hoop(3, 0, 1, math.pi)),
    "beyond": one_line(Hoop(6, 0, 1)),
    "twice": one_line(Hoop(2.5, 0, 1), Hoop(2.5, 0, 1)),
    "near": one_line(Hoop(2.5, 0, 1), Hoop(2.501, 0, 1)),
    "at the goal": one_line(Hoop(5, 0, 1)),
    "at the start": one_line(Hoop(0, 0, 1)),
    "back at the start": one_line(Hoop(0, 0, 1, math.pi)),
    "behind the start": one_line(Hoop(-1, 0, 1)),
    "facing": one_line(Hoop(2.5, 0, 1), Hoop(2.5, 0, 1, math.pi)),
    "there and back": one_line(Hoop(2.5, 0, 1), Hoop(2.5, 0, 1, math.pi), goal=(0, 0.5)),
    "three times": one_line(*[Hoop(2.5, 0, 1)] * 3),
    "1 mm behind": one_line(Hoop(2.5, 0, 1), Hoop(2.499, 0, 1)),
    "ladder": replace(SCENARIOS["ladder"], start=(-0.44156129912816466, -0.16570551267770497)),
}


@pytest.mark.parametrize("name", TURNING)
def test_hoops_reached_by_turning_round_are_counted_by_certificate_and_environment(name):
    solution, steps = solve(TURNING[name], max_gap=None), fewest_steps(TURNING[name], time_budget=0.0)
    assert solution.certificate.holds()
    assert len(replay_to_goal(TURNING[name], steps.actions)) == steps.steps + 1
    assert steps.steps * TURNING[name].dt == pytest.approx(solution.time, rel=0.04)


def test_a_second_hoop_that_the_first_flight_passes_costs_nothing():
    alone = solve(one_line(Hoop(2.5, 0, 1)), max_gap=None).time
    assert solve(TURNING["near"], max_gap=None).time == pytest.approx(alone, rel=1e-4)


@pytest.mark.parametrize("x", [-0.3, -0.5, -1.0])
def test_a_hoop_behind_the_start_takes_the_same_steps_in_both_directions(x):
    # The flight turns round at the hoop. The tolerance at the goal saves one or two steps.
    forward, back = one_line(Hoop(x, 0, 1)), one_line(Hoop(x, 0, 1, math.pi))
    steps = fewest_steps(forward, time_budget=0.0).steps
    assert steps == fewest_steps(back, time_budget=0.0).steps
    assert steps * forward.dt < solve(forward, max_gap=None).time


def test_twelve_hoops_take_no_more_steps_than_a_free_flight_to_the_tolerance(zigzag):
    target = SCENARIOS["zigzag-12"]
    free = min(solve_tolerant(target, shot).trajectory.duration for shot in zigzag)
    found = search_steps(target, zigzag, bound=0)
    assert len(found.actions) == math.ceil(free / target.dt)
    np.testing.assert_array_equal(replay_to_goal(target, found.actions), found.states)


def test_a_step_is_removed_from_twelve_hoops_in_a_limited_number_of_solves(zigzag, monkeypatch):
    target, calls, solve_program = SCENARIOS["zigzag-12"], [], program.solve_program
    flight = solve_tolerant(target, zigzag[0]).trajectory
    best = solve_in_steps(target, flight, zigzag[0].winding, math.ceil(flight.duration / target.dt))
    monkeypatch.setattr(program, "solve_program", lambda *args: calls.append(args) or solve_program(*args))
    assert remove_one_step(target, best) is None
    assert len(calls) <= MAX_ASSIGNMENTS + MAX_ROUNDS
