"""Verification: datasets of another scenario, environment or observation are refused."""

import json
from pathlib import Path

import minari
import pytest

from agents import demonstrations
from flatgym import Distribution, __version__


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
    with pytest.raises(ValueError, match="names no scenario; wanted one that `flatquad demos` recorded"):
        demonstrations.check(foreign, "random-goal")
