"""Demonstrations: planned alike by whoever works, stored as the environment said, flown anew to the goal."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import minari
import numpy as np
import pandas as pd
import pytest

import agents
from agents import demonstrations
from agents.demonstrations.plans import START_SPREAD
from agents.demonstrations.storage import ABANDONED, staging_folder
from flatgym import DISTRIBUTIONS, SCENARIOS, Distribution, Hoop, Scenario, __version__, observation_names
from optimal import SolveFailed

LOW = Scenario("low", (0, 0), (1, 0), floor=0.0)


@pytest.fixture(scope="module")
def grounded():
    """Flights above a floor: the scenario's own, one from a displaced start, and a continuation of each."""
    return demonstrations.plan(LOW, 2, seed=1, perturbed=1, jobs=1)


@pytest.fixture(scope="module")
def goals():
    """Flights to random goals."""
    return demonstrations.plan("random-goal", 2, seed=5, jobs=1)


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))


def contents(dataset):
    """Return all that the episodes of a dataset hold, exactly."""
    return [
        (
            *(array.tobytes() for array in (episode.observations, episode.actions, episode.rewards)),
            episode.infos["state"].tobytes(),
            repr(sorted(known.items())),
        )
        for episode, known in zip(
            dataset.iterate_episodes(), dataset.storage.get_episode_metadata(dataset.episode_indices), strict=True
        )
    ]


def facts(dataset):
    return list(dataset.storage.get_episode_metadata(dataset.episode_indices))


def test_stored_episodes_replay_to_the_goal_as_they_were_flown(grounded, capsys):
    demonstrations.record(LOW, grounded)
    demonstrations.record(LOW, grounded)  # again: replaces it, without a word
    assert capsys.readouterr().out == ""
    dataset = minari.load_dataset("flatquad/low/optimal-v0")
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


def test_an_episode_tells_what_is_known_of_it(grounded):
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


def test_the_first_flight_is_the_scenarios_own_and_the_others_begin_elsewhere(grounded):
    own, near, *continued = grounded
    assert own.options is None
    assert own.steps == own.flight.lower_bound == 27
    assert 0 < np.hypot(*(near.options["state"][:2])) <= START_SPREAD
    assert not near.options["state"][2:].any()
    for one in continued:
        assert one.options["state"][2:].all()
        assert one.options["state"][1] >= 0


def test_the_seed_of_a_random_goal_gives_its_very_scenario(goals):
    dataset = demonstrations.record("random-goal", goals)
    env = dataset.recover_environment()
    for number, known in enumerate(facts(dataset)):
        env.reset(seed=known["seed"])
        assert "options" not in known
        assert known["seed"] == 5 + number
        assert env.unwrapped.scenario == DISTRIBUTIONS["random-goal"].scenario(5 + number, 0)
        assert Scenario.from_json(known["scenario"]) == env.unwrapped.scenario
    assert [one.outcome for one in demonstrations.replay(dataset)] == ["goal", "goal"]


def test_what_is_planned_depends_on_the_seed_alone(goals):
    told = []
    (later,) = demonstrations.plan("random-goal", 1, seed=6, jobs=1, progress=lambda *counts: told.append(counts))
    assert later.scenario == goals[1].scenario
    np.testing.assert_array_equal(later.flight.actions, goals[1].flight.actions)
    assert told[-1] == (1, 1)


def test_flights_through_hoops_go_on_where_they_were_knocked_off():
    scenario = Scenario("through", (0, 0), (1, 0), hoops=(Hoop(0.5, 0, 1.0),))
    flights = demonstrations.plan(scenario, 1, seed=3, perturbed=2, jobs=1)
    assert len(flights) == 3
    assert len({one.hoops_passed for one in flights}) > 1
    dataset = demonstrations.record(scenario, flights)
    assert dataset.id == "flatquad/through/optimal-v0"
    assert dataset.recover_environment().unwrapped.scenario == scenario
    assert [(one.outcome, one.steps) for one in demonstrations.replay(dataset)] == [
        ("goal", one.steps) for one in flights
    ]


def test_displaced_starts_stay_near_above_the_floor_and_off_the_goal(generator):
    near_goal = Scenario("near", (0, 0), (0.3, 0.1), floor=0.0)
    for _ in range(300):
        start = np.array(demonstrations.displaced(near_goal, generator, 0.4).start)
        assert np.hypot(*start) <= 0.4
        assert start[1] >= 0
        assert np.hypot(*(start - near_goal.goal)) > near_goal.tolerance.position


def test_what_cannot_be_flown_is_said():
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
        (("hoop", 2, 0, 0.0), "all 2 flights of 'hoop' would be the same; ask for 1"),
        (("hoop", 2, 0, -1.0), r"plan.spread must be at least 0, got -1.0"),
        (("hoop", 2, 0, None, -1), "perturbed must be a whole number in 0"),
    ],
)
def test_wrong_orders_are_refused(arguments, words):
    names = ("problem", "episodes", "seed", "spread", "perturbed")
    with pytest.raises(ValueError, match=words):
        demonstrations.plan(**dict(zip(names, arguments, strict=False)))


SCRIPT = """
import sys
from agents import demonstrations
flights = demonstrations.plan("random-goal", 5, jobs=1, store=demonstrations.flights_folder())
demonstrations.record("random-goal", flights, "killed")
"""


@pytest.fixture(scope="module")
def uninterrupted():
    return demonstrations.plan("random-goal", 5, jobs=1)


@pytest.mark.parametrize("moment", ["planning", "recording"])
def test_a_run_killed_at_any_moment_goes_on_with_nothing_lost_or_doubled(tmp_path, uninterrupted, moment):
    def reached():
        if moment == "planning":
            return len(list(demonstrations.flights_folder().glob("[!.]*.json"))) >= 2
        return any(staging_folder().glob("recording-*"))

    child = subprocess.Popen(
        [sys.executable, "-c", SCRIPT],
        cwd=Path(agents.__file__).parents[1],
        env=os.environ | {"MINARI_DATASETS_PATH": str(tmp_path)},
    )
    until = time.monotonic() + 60
    while not reached() and child.poll() is None and time.monotonic() < until:
        time.sleep(0.001)
    child.send_signal(signal.SIGKILL)
    assert child.wait() == -signal.SIGKILL
    assert not minari.list_local_datasets()
    kept = {path: path.stat().st_mtime_ns for path in demonstrations.flights_folder().glob("[!.]*.json")}
    assert 2 <= len(kept) < 5 if moment == "planning" else len(kept) == 5
    for left in staging_folder().glob("recording-*"):  # a day later
        os.utime(left, (time.time() - ABANDONED - 1,) * 2)

    flights = demonstrations.plan("random-goal", 5, jobs=1, store=demonstrations.flights_folder())
    resumed = demonstrations.record("random-goal", flights, "killed")
    assert all(path.stat().st_mtime_ns == when for path, when in kept.items())
    assert contents(resumed) == contents(demonstrations.record("random-goal", uninterrupted, "whole"))
    assert list(minari.list_local_datasets()) == ["killed-v0", "whole-v0"]
    assert [path.name for path in staging_folder().iterdir()] == [demonstrations.flights_folder().name]


def test_continuations_are_kept_in_the_store_too(tmp_path, monkeypatch):
    first = demonstrations.plan(LOW, 1, perturbed=1, jobs=1, store=tmp_path)
    monkeypatch.setattr("agents.demonstrations.perturbed.replan", lambda *_: pytest.fail("planned again"))
    again = demonstrations.plan(LOW, 1, perturbed=1, jobs=1, store=tmp_path)
    assert len(again) == 2
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.flight.actions, other.flight.actions)
        np.testing.assert_array_equal(one.flight.states, other.flight.states)


def test_a_flight_that_misses_the_goal_leaves_the_older_dataset_as_it_was(goals):
    before = contents(demonstrations.record("random-goal", goals, "kept"))
    short = demonstrations.Demonstration(SCENARIOS["horizontal-3"], goals[0].flight, 0)
    with pytest.raises(RuntimeError, match=r"a planned flight of .* ended as"):
        demonstrations.record("horizontal-3", [short], "kept")
    swapped = demonstrations.Demonstration(goals[1].scenario, goals[0].flight, goals[0].seed)
    with pytest.raises(RuntimeError, match=r"seed 5 gives .*random-goal-5-0.* not .*random-goal-6-0"):
        demonstrations.record("random-goal", [swapped], "kept")
    assert contents(minari.load_dataset("kept-v0")) == before
    assert list(staging_folder().iterdir()) == []


def test_a_full_disk_is_named_and_the_older_dataset_as_it_was(goals):
    before = contents(demonstrations.record("random-goal", goals[:1]))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    try:
        with pytest.raises(OSError, match=r"older dataset of this name is as it was: make room.*optimal-v0'"):
            demonstrations.record("random-goal", goals)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert contents(minari.load_dataset("flatquad/random-goal/optimal-v0")) == before
    assert list(staging_folder().iterdir()) == []


def test_an_older_dataset_comes_back_when_the_new_one_cannot_take_its_place(goals, monkeypatch):
    before = contents(demonstrations.record("random-goal", goals[:1], "kept"))
    rename = Path.rename

    def refused(path, target):
        if path.name == "made":
            raise PermissionError(13, "Permission denied")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", refused)
    with pytest.raises(PermissionError, match="Permission denied; an older dataset"):
        demonstrations.record("random-goal", goals, "kept")
    assert contents(minari.load_dataset("kept-v0")) == before


def test_names_and_problems_that_minari_cannot_hold_are_refused(goals):
    with pytest.raises(ValueError, match=r"letters, digits.* got 'my goals'"):
        demonstrations.record("random-goal", goals, "my goals")
    with pytest.raises(ValueError, match="cannot hold the distribution 'mine'; named ones: random-goal"):
        demonstrations.record(Distribution("mine"), goals)
    with pytest.raises(ValueError, match="no demonstrations of 'random-goal'"):
        demonstrations.record("random-goal", [])
    demonstrations.record("random-goal", goals, "a-v0/b-v0")
    with pytest.raises(ValueError, match="'a-v0' is a namespace of other datasets"):
        demonstrations.record("random-goal", goals, "a-v0")


def rewritten(dataset, **changes):
    """Return the dataset with other metadata."""
    path = Path(dataset.storage.data_path, "metadata.json")
    metadata = json.loads(path.read_text())
    path.write_text(json.dumps({key: value for key, value in (metadata | changes).items() if value is not None}))
    return minari.load_dataset(dataset.id)


def test_a_dataset_of_another_scenario_or_environment_is_refused(goals):
    dataset = demonstrations.record("random-goal", goals)
    demonstrations.check(dataset, "random-goal")
    with pytest.raises(ValueError, match=r"is of 'random-goal', wanted 'hoop'; they differ in .*goal: None and"):
        demonstrations.check(dataset, "hoop")
    with pytest.raises(ValueError, match=r"wanted 'random-goal'; they differ in dt: 0.02 and 0.01$"):
        demonstrations.check(dataset, Distribution("random-goal", dt=0.01))
    with pytest.raises(ValueError, match=r"holds the observations goal_x.* has x, z, vx, vz, theta as 'state'"):
        demonstrations.check(dataset, "random-goal", observation="state")
    spec = dataset.storage.metadata["env_spec"]
    newer = rewritten(dataset, env_spec=spec.replace("FlatQuad-v0", "FlatQuad-v1"))
    with pytest.raises(ValueError, match="is of FlatQuad-v1, wanted one of FlatQuad-v0"):
        demonstrations.check(newer, "random-goal")
    older = rewritten(dataset, env_spec=spec, flatgym_version="0.0.1", observation_names=["x", "z"])
    with pytest.raises(ValueError, match=rf"of flatgym 0.0.1 holds the observations x, z; flatgym {__version__} has"):
        demonstrations.check(older, "random-goal")
    foreign = rewritten(dataset, problem=None)
    with pytest.raises(ValueError, match="does not tell its scenario; wanted one that `flatquad demos` recorded"):
        demonstrations.check(foreign, "random-goal")


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_tables_hold_the_very_numbers(grounded, tmp_path, ending):
    dataset = demonstrations.record(LOW, grounded)
    path = demonstrations.export(dataset, tmp_path / "tables" / f"flights.{ending}")
    rows = pd.read_csv(path) if ending == "csv" else pd.read_parquet(path)
    states = ["x_m", "z_m", "vx_mps", "vz_mps", "theta_rad"]
    for number, (episode, one) in enumerate(zip(dataset.iterate_episodes(), grounded, strict=True)):
        flown = rows[rows.episode == number]
        assert flown.step.tolist() == list(range(one.steps + 1))
        assert set(flown.k_star) == {one.steps}
        np.testing.assert_allclose(flown.t_s, 0.02 * flown.step)
        np.testing.assert_array_equal(flown[states], episode.infos["state"])
        np.testing.assert_array_equal(flown[list(observation_names())].astype(np.float32), episode.observations)
        held, arrival = flown.iloc[:-1], flown.iloc[-1]
        np.testing.assert_array_equal(held[["action_0", "action_1"]].astype(np.float32), episode.actions)
        controls = one.scenario.quadrotor.control(episode.actions)
        np.testing.assert_allclose(held[["thrust_mps2", "rate_radps"]], controls, rtol=1e-6, atol=1e-6)
        np.testing.assert_array_equal(held.reward, episode.rewards)
        assert arrival[["action_0", "action_1", "thrust_mps2", "rate_radps", "reward"]].isna().all()


def test_tables_that_cannot_be_written_are_refused(goals, tmp_path, monkeypatch):
    dataset = demonstrations.record("random-goal", goals)
    with pytest.raises(ValueError, match=r"unknown ending '.txt' of flights.txt; known: .csv, .parquet"):
        demonstrations.export(dataset, tmp_path / "flights.txt")
    monkeypatch.setattr("flatgym.extras.find_spec", lambda _: None)
    with pytest.raises(ImportError, match=r"pyarrow not installed; run: pip install 'flatgym\[parquet\]'"):
        demonstrations.export(dataset, tmp_path / "flights.parquet")
    assert not list(tmp_path.glob("flights*"))
