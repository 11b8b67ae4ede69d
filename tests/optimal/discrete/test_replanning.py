"""Replanning: the remaining part of an optimal flight is optimal, and plans from perturbed states reach the goal."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Scenario
from optimal import fewest_steps
from optimal.discrete.replanning import RemainingTask, remaining_trajectory, replan


@pytest.fixture(scope="module")
def flights():
    return {name: fewest_steps(name, windings=(w,), time_budget=0.0) for name, w in [("horizontal-6", 0), ("hoop", 0)]}


@pytest.mark.parametrize("step", [1, 20, 55])
@pytest.mark.parametrize("name", ["horizontal-6", "hoop"])
def test_replanning_on_an_optimal_flight_takes_the_remaining_steps(flights, name, step):
    flight, passed = flights[name], int(name == "hoop" and step > 40)
    task = RemainingTask.of(flight.scenario, flight.states[step], passed)
    found = replan(task, remaining_trajectory(flight, step, flight.scenario), 0)
    assert len(found.actions) == flight.steps - step


def test_a_plan_from_a_perturbed_state_reaches_the_goal(flights, generator):
    flight, env = flights["horizontal-6"], gym.make("FlatQuad-v0", scenario="horizontal-6")
    for step in (10, 30, 50):
        state = flight.states[step] + generator.normal(size=5) * np.array([0.1, 0.1, 0.2, 0.2, 0.1])
        remaining = remaining_trajectory(flight, step, flight.scenario)
        found = replan(RemainingTask.of(flight.scenario, state), remaining, flight.winding)
        env.reset(options={"state": state})
        for action in found.actions:
            info = env.step(action)[4]
        assert (info["outcome"], info["steps"]) == ("goal", len(found.actions))


def test_a_remaining_task_has_the_remaining_hoops():
    scenario = SCENARIOS["slalom"]
    state = np.array([3.0, 1.0, 5.0, -2.0, 7.0])
    left = RemainingTask.of(scenario, state, 1)
    assert left.hoops == scenario.hoops[1:]
    assert left.start == (2.5, 1.5)
    np.testing.assert_array_equal(left.start_state, state)
    # This holds even where the goal is the start, because the last hoop passed replaces the start.
    lap = Scenario("lap", (0, 0), (0, 0), hoops=(Hoop(2, 0, 1.0),))
    assert RemainingTask.of(lap, lap.start_state, 1).goal == (0, 0)


def test_without_enough_time_there_is_no_plan(flights):
    flight = flights["horizontal-6"]
    short = replace(flight.scenario, time_limit=0.3)
    remaining = remaining_trajectory(flight, 5, flight.scenario)
    assert replan(RemainingTask.of(short, flight.states[5]), remaining, 0) is None
