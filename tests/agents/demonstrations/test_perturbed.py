"""Perturbed demonstrations: they replay to the goal and are stored."""

import numpy as np
import pytest

from agents import demonstrations
from flatgym import Hoop, Scenario

LOW = Scenario("low", (0, 0), (1, 0), floor=0.0)


def test_perturbed_flights_through_hoops_replay_to_the_goal():
    scenario = Scenario("through", (0, 0), (1, 0), hoops=(Hoop(0.5, 0, 1.0),))
    flights = demonstrations.plan(scenario, 1, seed=3, perturbed=2, jobs=1)
    assert len(flights) == 3
    assert len({one.hoops_passed for one in flights}) > 1
    dataset = demonstrations.record(scenario, flights)
    assert dataset.id == f"flatquad/through-{scenario.digest[:8]}/best-known-v0"
    assert dataset.recover_environment().unwrapped.scenario == scenario
    assert [(one.outcome, one.steps) for one in demonstrations.replay(dataset)] == [
        ("goal", one.steps) for one in flights
    ]


def test_replanned_flights_are_stored(tmp_path, monkeypatch):
    first = demonstrations.plan(LOW, 1, perturbed=1, jobs=1, store=tmp_path)
    monkeypatch.setattr("agents.demonstrations.perturbed.replan", lambda *_: pytest.fail("planned again"))
    again = demonstrations.plan(LOW, 1, perturbed=1, jobs=1, store=tmp_path)
    assert len(again) == 2
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.flight.actions, other.flight.actions)
        np.testing.assert_array_equal(one.flight.states, other.flight.states)
