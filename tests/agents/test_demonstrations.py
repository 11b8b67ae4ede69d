"""Demonstrations are what the environment said: stored episodes replay to the goal."""

import minari
import numpy as np
import pytest

from agents import demonstrations
from flatgym import SCENARIOS, Hoop, Scenario


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))


def test_stored_episodes_replay_to_the_goal(capsys):
    flights = demonstrations.plan("ground-6", 3, seed=1)
    assert len({flight.scenario.start for flight in flights}) == 3
    assert all(flight.scenario.start[1] >= 0 for flight in flights)
    demonstrations.record("ground-6", flights)
    demonstrations.record("ground-6", flights)  # again: replaces it, without a word
    assert capsys.readouterr().out == ""
    dataset = minari.load_dataset("flatquad/ground-6/optimal-v0")
    env = dataset.recover_environment()
    assert dataset.total_episodes == 3
    for flight, episode in zip(flights, dataset.iterate_episodes(), strict=True):
        observation, _ = env.reset(options={"state": flight.scenario.start_state})
        np.testing.assert_array_equal(observation, episode.observations[0])
        for action in episode.actions:
            observation, _, terminated, _, info = env.step(action)
        assert terminated
        assert info["outcome"] == "goal"
        assert len(episode.actions) == flight.steps
        assert episode.rewards.sum() == pytest.approx(-flight.steps * flight.scenario.dt)
        np.testing.assert_array_equal(observation, episode.observations[-1])


def test_a_scenario_of_ones_own_is_recorded_whole():
    mine = Scenario("mine", (0, 0), (2, 1), hoops=(Hoop(1, 0.5, 0.8),))
    dataset = demonstrations.record(mine, demonstrations.plan(mine, 1))
    assert dataset.recover_environment().unwrapped.scenario == mine


def test_a_flight_that_misses_the_goal_is_not_stored():
    flights = demonstrations.plan("horizontal-3", 1)
    with pytest.raises(RuntimeError, match="ended as"):
        demonstrations.record("horizontal-6", flights)
    assert not minari.list_local_datasets()


def test_displaced_starts_stay_near_and_above_the_floor(generator):
    ground = SCENARIOS["ground-6"]
    for _ in range(100):
        start = np.array(demonstrations.displaced(ground, generator).start)
        assert np.hypot(*(start - ground.start)) <= demonstrations.START_SPREAD
        assert start[1] >= 0
