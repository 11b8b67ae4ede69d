"""Replays: recorded flights end as they ended, in both implementations, and a margin moves the limits."""

from dataclasses import replace as changed

import numpy as np
import pytest

from agents.controllers.cascaded_pd import CascadedPD
from agents.evaluation.replay import FLEETS, replay
from agents.evaluation.rollouts import fly
from flatgym import SCENARIOS, Disturbances, Hoop, Quadrotor, Scenario
from flatgym.envs.config import EnvConfig
from flatgym.scenarios.reference import ghost_states, reference

PD = CascadedPD(Quadrotor())
DISTURBED = Disturbances(wind=1.0, thrust_gain=0.05, mass=0.05, action_delay=2, sensor_noise=0.02)


@pytest.mark.parametrize("implementation", FLEETS)
@pytest.mark.parametrize("disturbances", [Disturbances(), DISTURBED])
@pytest.mark.parametrize("problem", ["hoop", "random-goal", "random-hoops"])
def test_a_recorded_flight_ends_as_it_ended(problem, disturbances, implementation):
    flown = fly(PD, problem, 12, 1_000_003, disturbances)
    found = replay(problem, 1_000_003, flown.actions, disturbances, implementation=implementation)
    assert found.outcomes == flown.outcomes
    assert found.steps.tolist() == flown.steps.tolist()
    other = replay(problem, 1_000_004, flown.actions, disturbances, implementation=implementation)
    assert (other.outcomes == flown.outcomes) == (problem == "hoop" and not disturbances.active)


class Double:
    """Returns float64 actions outside the box too; the environment clips them."""

    def predict(self, observation, state=None, **_):
        return 1.5 * np.sin(1e3 * np.asarray(observation, dtype=np.float64)[:, 2:4]), state


def test_what_is_recorded_is_what_was_flown():
    flown = fly(Double(), "random-goal", 8, 5)
    assert all(one.dtype == np.float32 and np.abs(one).max() == 1 for one in flown.actions)
    for i, actions in enumerate(flown.actions):
        states = Quadrotor().fly(flown.states[i][0], Quadrotor().control(actions), 0.02)
        assert np.abs(states - flown.states[i]).max() < 1e-9


@pytest.mark.parametrize("implementation", FLEETS)
@pytest.mark.parametrize("name", SCENARIOS)
def test_the_stored_flights_do_not_depend_on_rounding(name, implementation):
    known = reference(name)
    for margin in (0.0, -1e-9, 1e-9):
        found = replay(name, 0, [known.actions], implementation=implementation, margin=margin)
        assert (*found.outcomes, *found.steps) == ("goal", known.k_star)


@pytest.mark.parametrize("implementation", FLEETS)
def test_a_flight_that_goes_on_or_ended_before_is_told(implementation):
    known = reference("hoop")
    longer = np.concatenate([known.actions, np.zeros((3, 2), np.float32)])
    found = replay("hoop", 0, [known.actions[:-1], longer], implementation=implementation)
    assert found.outcomes == ("flying", "goal")
    assert found.steps.tolist() == [known.k_star - 1, known.k_star]


@pytest.mark.parametrize("implementation", FLEETS)
def test_a_margin_moves_every_limit(implementation):
    """Each flight here just misses a limit, or just keeps it, and a margin turns it."""

    def ends(scenario, actions, margin=0.0):
        (outcome,) = replay(scenario, 0, [actions], implementation=implementation, margin=margin).outcomes
        return outcome

    known, hoop, q = reference("hoop"), SCENARIOS["hoop"], Quadrotor()
    assert ends(hoop, known.actions, -1e-3) == "flying"  # beside the gap
    end = ghost_states("hoop")[-1]
    for name, least in (("position", np.hypot(*(end[:2] - 5))), ("speed", np.hypot(*end[2:4])), ("angle", abs(end[4]))):
        near = changed(hoop, tolerance=changed(hoop.tolerance, **{name: least - 1e-6}))
        assert (ends(near, known.actions), ends(near, known.actions, 1e-5)) == ("flying", "goal")
    hover = np.full((50, 2), 0.0, np.float32)
    hover[:, 0] = np.float32(q.action([q.gravity, 0.0])[0])
    sink = hover.copy()
    sink[:, 0] -= np.float32(1e-3)
    low = Scenario("low", (0.0, 0.0), (3.0, 0.0), floor=-0.001, time_limit=1.0)
    assert (ends(low, sink), ends(low, sink, 0.1)) == ("floor", "time-limit")
    rise = hover + np.float32([1e-3, 0.0])
    high = Scenario("high", (0.0, 0.0), (3.0, 0.0), ceiling=0.001, time_limit=1.0)
    assert (ends(high, rise), ends(high, rise, 0.1)) == ("ceiling", "time-limit")
    assert ends(low, hover) == ends(low, hover, -1e-9) == "time-limit"
    body = Scenario(
        "body", (0.0, 0.0), (0.0, 2.0), (Hoop(0.0, 0.5, 0.41, np.pi / 2),), quadrotor=Quadrotor(radius=0.2),
        time_limit=1.0,
    )  # fmt: skip
    up = np.ones((50, 2), np.float32) * np.float32([1.0, 0.0])
    assert (ends(body, up) == "collision", ends(body, up, -0.01)) == (False, "collision")


def test_a_margin_moves_the_gaps_of_sampled_scenes():
    actions = fly(PD, "random-hoops", 12, 3).actions
    wide, narrow = (
        [replay("random-hoops", 3, actions, implementation=name, margin=margin).outcomes for name in FLEETS]
        for margin in (0.0, -0.24)
    )
    assert wide[0] == wide[1]
    assert narrow[0] == narrow[1] != wide[0]


def test_a_negative_margin_leaves_half_of_a_tolerance():
    tight = changed(SCENARIOS["hoop"], tolerance=changed(SCENARIOS["hoop"].tolerance, speed=1e-10))
    assert EnvConfig(tight, margin=-1e-9).tolerance.speed == 0.5e-10
    assert EnvConfig(tight).tolerance is tight.tolerance


def test_a_margin_leaves_an_angle_within_half_a_turn():
    any_tilt = changed(SCENARIOS["hoop"], tolerance=changed(SCENARIOS["hoop"].tolerance, angle=np.pi))
    assert EnvConfig(any_tilt, margin=1e-9).tolerance.angle == np.pi
