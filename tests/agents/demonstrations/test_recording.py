"""Recording: datasets hold what the environment returns, and only complete flights."""

from dataclasses import replace

import minari
import numpy as np
import pytest

from agents import demonstrations
from agents.demonstrations.storage import staging_folder
from flatgym import DISTRIBUTIONS, SCENARIOS, Distribution, Scenario, __version__
from flatgym.scenarios.catalogue import label
from flatgym.scenarios.reference import EVALUATION_SEED

LOW = Scenario("low", (0, 0), (1, 0), floor=0.0)


def facts(dataset):
    return list(dataset.storage.get_episode_metadata(dataset.episode_indices))


def test_stored_episodes_replay_to_the_goal_bit_for_bit(grounded, capsys):
    demonstrations.record(LOW, grounded)
    demonstrations.record(LOW, grounded, if_exists="replace")
    assert capsys.readouterr().out == ""
    dataset = minari.load_dataset(f"flatquad/{label(LOW)}/best-known-v0")
    assert list(minari.list_local_datasets()) == [dataset.id]
    replays = demonstrations.replay(dataset)
    assert [(one.outcome, one.steps) for one in replays] == [("goal", one.steps) for one in grounded]
    assert all(one.steps == one.k_star for one in replays)
    env = dataset.recover_environment()
    for one, known, episode in zip(grounded, facts(dataset), dataset.iterate_episodes(), strict=True):
        observation, info = env.reset(seed=known["seed"], options=known.get("options"))
        np.testing.assert_array_equal(info["state"], one.flight.states[0])
        observations, states, rewards = [observation], [info["state"]], []
        for action in episode.actions:
            observation, reward, terminated, _, info = env.step(action)
            observations.append(observation)
            states.append(info["state"])
            rewards.append(reward)
        assert terminated
        np.testing.assert_array_equal(observations, episode.observations)
        np.testing.assert_array_equal(states, episode.infos["state"])
        np.testing.assert_array_equal(rewards, episode.rewards)
        assert sum(rewards) == pytest.approx(-one.steps * one.scenario.dt)


def test_episode_metadata_holds_bound_proof_and_scenario(grounded):
    dataset = demonstrations.record(LOW, grounded, "mine")
    assert dataset.id == "mine-v0"
    for one, known in zip(grounded, facts(dataset), strict=True):
        assert Scenario.from_json(known["scenario"]) == LOW
        assert (known["k_star"], known["winding"]) == (one.steps, one.flight.winding)
        assert known["lower_bound"] == one.flight.lower_bound <= known["k_star"]
        assert bool(known["proven"]) == one.flight.proven == (known["lower_bound"] == known["k_star"])
        assert 0 < known["tolerance_used"] < 1
    assert dataset.storage.metadata["flatgym_version"] == __version__
    assert f"flatgym=={__version__}" in dataset.storage.metadata["requirements"]
    score = minari.get_normalized_score(dataset, np.array([-grounded[0].steps * 0.02, -5.0]))
    np.testing.assert_allclose(score, [1.0, 0.0])


def test_the_seed_of_an_episode_gives_its_scenario(goals):
    dataset = demonstrations.record("random-goal", goals)
    env = dataset.recover_environment()
    for number, known in enumerate(facts(dataset)):
        env.reset(seed=known["seed"])
        assert "options" not in known
        assert known["seed"] == 5 + number
        assert env.unwrapped.scenario == DISTRIBUTIONS["random-goal"].scenario(5 + number, 0)
        assert Scenario.from_json(known["scenario"]) == env.unwrapped.scenario
    assert [one.outcome for one in demonstrations.replay(dataset)] == ["goal", "goal"]


def test_a_distribution_of_ones_own_is_recorded_with_its_content():
    own = Distribution("random-goal", half_width=1.0)  # not the built-in one
    flights = demonstrations.plan(own, 2, jobs=1)
    dataset = demonstrations.record(own, flights)
    assert dataset.id == f"flatquad/random-goal-{own.digest[:8]}/best-known-v0"
    env = dataset.recover_environment()
    env.reset(seed=1)
    assert env.unwrapped.scenario == own.scenario(1)
    demonstrations.check(dataset, own)
    demonstrations.check(dataset, replace(own, name="renamed"))
    with pytest.raises(ValueError, match=r"they differ in half_width: 1\.0 and 10\.0"):
        demonstrations.check(dataset, "random-goal")


def test_a_flight_that_misses_the_goal_leaves_the_older_dataset_unchanged(goals, contents):
    before = contents(demonstrations.record("random-goal", goals, "kept"))
    short = demonstrations.Demonstration(SCENARIOS["horizontal-3"], goals[0].flight, 0)
    with pytest.raises(RuntimeError, match=r"a planned flight of .* ended as"):
        demonstrations.record("horizontal-3", [short], "kept", if_exists="replace")
    swapped = demonstrations.Demonstration(goals[1].scenario, goals[0].flight, goals[0].seed)
    with pytest.raises(RuntimeError, match=r"seed 5 gives .*random-goal-5-0.* not .*random-goal-6-0"):
        demonstrations.record("random-goal", [swapped], "kept", if_exists="replace")
    assert contents(minari.load_dataset("kept-v0")) == before
    assert list(staging_folder().iterdir()) == []


def test_tasks_that_score_policies_are_recorded_with_a_warning(goals, grounded):
    scored = demonstrations.plan("random-goal", 1, seed=EVALUATION_SEED, jobs=1)
    with pytest.warns(UserWarning, match=r"tasks that score policies, .* from 1000000 on \(its last seed is 1000000\)"):
        demonstrations.record("random-goal", [*goals, *scored])
    far = [replace(one, seed=one.seed + EVALUATION_SEED) for one in grounded]
    demonstrations.record(LOW, far)  # the task is one for all seeds
