"""Planned demonstrations and a dataset folder that the tests of demonstrations share."""

import pytest

from agents import demonstrations
from flatgym import Scenario

LOW = Scenario("low", (0, 0), (1, 0), floor=0.0)


@pytest.fixture(scope="session")
def grounded():
    """Flights above a floor: the scenario's own, one from a displaced start, and a perturbed copy of each."""
    return demonstrations.plan(LOW, 2, seed=1, perturbed=1, jobs=1)


@pytest.fixture(scope="session")
def goals():
    """Flights to random goals."""
    return demonstrations.plan("random-goal", 2, seed=5, jobs=1)


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    """Minari's datasets go to the folder of the test."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))


@pytest.fixture
def contents():
    """A function that returns the exact content of all episodes of a dataset."""

    def read(dataset):
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

    return read
