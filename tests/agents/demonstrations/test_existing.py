"""Existing datasets: refused, replaced, or extended with new episodes, and never lost."""

import minari
import pytest

from agents import demonstrations
from agents.demonstrations.storage import staging_folder
from flatgym import Scenario

LOW = Scenario("low", (0, 0), (1, 0), floor=0.0)


@pytest.fixture
def stored(goals):
    """A dataset with the flights of two seeds."""
    return demonstrations.record("random-goal", goals)


def test_an_existing_dataset_is_refused_by_name_and_unchanged(goals, stored, contents):
    before = contents(stored)
    with pytest.raises(
        ValueError,
        match=r"'flatquad/random-goal/best-known-v0' exists, with 2 episodes: .*--append.*--overwrite.*--out",
    ):
        demonstrations.record("random-goal", goals[:1])
    with pytest.raises(ValueError, match="unknown if_exists 'repalce'; known: fail, replace, append; did you mean"):
        demonstrations.record("random-goal", goals[:1], if_exists="repalce")
    assert contents(minari.load_dataset(stored.id)) == before
    assert not staging_folder().exists() or list(staging_folder().iterdir()) == []


def test_a_dataset_is_replaced_when_asked(goals, stored, contents):
    replaced = demonstrations.record("random-goal", goals[:1], if_exists="replace")
    assert replaced.id == stored.id
    assert contents(replaced) == contents(demonstrations.record("random-goal", goals[:1], "other"))


def test_appended_episodes_follow_the_stored_ones_as_if_recorded_together(goals, contents):
    first = demonstrations.record("random-goal", goals[:1])
    assert demonstrations.next_seed(first) == 6
    both = demonstrations.record("random-goal", goals[1:], if_exists="append")
    together = demonstrations.record("random-goal", goals, "together")
    assert contents(both) == contents(together)
    names = ("total_episodes", "total_steps", "ref_max_score", "proven_share", "description", "problem")
    assert {name: both.storage.metadata[name] for name in names} == {
        name: together.storage.metadata[name] for name in names
    }
    assert [one.outcome for one in demonstrations.replay(both)] == ["goal", "goal"]


def test_appending_refuses_episodes_that_are_stored_and_other_problems(goals, stored, grounded, contents):
    before = contents(stored)
    with pytest.raises(ValueError, match=r"already holds the episode with seed 6 .*first unused seed is 7"):
        demonstrations.record("random-goal", goals[1:], if_exists="append")
    with pytest.raises(ValueError, match=r"is of 'random-goal', wanted 'low'"):
        demonstrations.record(LOW, grounded, stored.id, if_exists="append")
    assert contents(minari.load_dataset(stored.id)) == before


@pytest.mark.parametrize("name", ["main_data.hdf5", "metadata.json"])
def test_a_damaged_dataset_is_named_and_kept_until_it_is_replaced(goals, stored, name):
    file = stored.storage.data_path / name
    file.write_bytes(half := file.read_bytes()[: file.stat().st_size // 2])
    for if_exists in ("fail", "append"):
        with pytest.raises(ValueError, match=r"best-known-v0' exists and cannot be read \(.*\); .*--overwrite"):
            demonstrations.record("random-goal", goals, if_exists=if_exists)
        assert file.read_bytes() == half
    assert demonstrations.record("random-goal", goals, if_exists="replace").total_episodes == 2


def test_a_scenario_is_extended_by_displaced_starts_only(grounded):
    dataset = demonstrations.record(LOW, grounded[:2])
    with pytest.raises(ValueError, match="already holds the episode with seed 0"):
        demonstrations.record(LOW, demonstrations.plan(LOW, 1, jobs=1), if_exists="append")
    more = demonstrations.plan(LOW, 1, demonstrations.next_seed(dataset), own_start=False, jobs=1)
    assert [one.options is not None for one in more] == [True]
    assert demonstrations.record(LOW, more, if_exists="append").total_episodes == 3


def test_metadata_says_how_much_is_proven(grounded):
    own, displaced = grounded[:2]
    assert own.flight.proven
    share = [
        demonstrations.record(LOW, flights, f"proven-{len(flights)}").storage.metadata["proven_share"]
        for flights in ([own], [own, displaced])
    ]
    assert share == [1.0, (1 + displaced.flight.proven) / 2]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt(), MemoryError()])
def test_an_interrupt_while_a_dataset_is_replaced_restores_it(goals, stored, monkeypatch, contents, error):
    before, rename = contents(stored), type(staging_folder()).rename

    def interrupted(path, target):
        if path.name == "made":
            raise error
        return rename(path, target)

    monkeypatch.setattr(type(staging_folder()), "rename", interrupted)
    with pytest.raises(type(error)):
        demonstrations.record("random-goal", goals[:1], if_exists="replace")
    assert contents(minari.load_dataset(stored.id)) == before
