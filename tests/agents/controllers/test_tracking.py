"""Experts: exact tracking, recovery from perturbed starts, and more successes in wind than open-loop replay."""

import numpy as np
import pytest

from agents.controllers.mpc import MPC
from agents.controllers.tracking import Expert, OpenLoop
from agents.evaluation.rollouts import fly
from flatgym import Disturbances, Scenario
from flatgym.envs.vector import FlatQuadVectorEnv
from flatgym.scenarios.reference import reference
from optimal import fewest_steps, solve


@pytest.fixture(scope="module")
def flight():
    return fewest_steps("horizontal-6", windings=(0,), time_budget=0.0)


def test_without_disturbances_the_expert_repeats_its_flight(flight):
    flown = fly(Expert(flight), "horizontal-6", 2)
    assert flown.outcomes == ("goal", "goal")
    assert flown.steps.tolist() == [flight.steps] * 2
    np.testing.assert_allclose(flown.states[0], flight.states, atol=1e-4)


@pytest.mark.parametrize("name", ["hoop", "climb"])
def test_flips_and_hoops_are_tracked(name):
    flight = fewest_steps(name, windings=(reference(name).winding,), time_budget=0.0)
    assert fly(Expert(flight), name).steps[0] == flight.steps


def test_a_flight_in_continuous_time_is_tracked_to_the_goal():
    solution = solve("horizontal-6", max_gap=None)
    flown = fly(Expert(solution), "horizontal-6")
    assert flown.outcomes == ("goal",)
    assert reference("horizontal-6").k_star <= flown.steps[0] <= np.ceil(solution.time / 0.02) + 1


def test_from_perturbed_starts_the_expert_reaches_the_goal(flight, generator):
    expert, envs = Expert(flight), FlatQuadVectorEnv(50, scenario="horizontal-6")
    observations, infos = envs.reset(
        seed=0, options={"state": generator.normal(size=(50, 5)) * np.array([0.03, 0.03, 0.06, 0.06, 0.03])}
    )
    arrived = np.zeros(50, dtype=bool)
    for _ in range(flight.steps + 15):
        observations, _, _, _, infos = envs.step(expert.predict(observations)[0])
        arrived |= infos["is_success"]
    assert arrived.mean() >= 0.95


def test_in_wind_feedback_beats_open_loop_replay_and_mpc_succeeds(flight):
    wind = Disturbances(wind=0.5, mass=0.03)
    open_loop, expert = (
        np.mean([word == "goal" for word in fly(policy, "horizontal-6", 40, 0, wind).outcomes])
        for policy in (OpenLoop(flight), Expert(flight))
    )
    assert expert > open_loop + 0.2
    assert fly(MPC(flight), "horizontal-6", 1, 7, wind).outcomes == ("goal",)


def test_mpc_flies_k_star_without_disturbances_and_one_vehicle_only(flight):
    planner = MPC(flight)
    for _ in range(2):  # a new episode starts from the original plan
        assert fly(planner, "horizontal-6").steps[0] == flight.steps
    with pytest.raises(ValueError, match="flies one vehicle, got observations of 2"):
        fly(planner, "horizontal-6", 2)


def test_a_result_without_a_flight_is_refused():
    none = fewest_steps(Scenario("far", (0, 0), (90, 0), time_limit=1.0), raise_on_failure=False)
    with pytest.raises(ValueError, match="'far': the result has no flight"):
        Expert(none)
