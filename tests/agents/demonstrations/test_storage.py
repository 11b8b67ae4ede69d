"""Storage: interrupted runs, full disks and failed renames leave complete datasets."""

import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import minari
import pytest

import agents
from agents import demonstrations
from agents.demonstrations.storage import ABANDONED_AFTER, staging_folder

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
def test_a_killed_run_resumes_without_loss_or_duplicates(tmp_path, uninterrupted, moment, contents):
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
        os.utime(left, (time.time() - ABANDONED_AFTER - 1,) * 2)

    flights = demonstrations.plan("random-goal", 5, jobs=1, store=demonstrations.flights_folder())
    resumed = demonstrations.record("random-goal", flights, "killed")
    assert all(path.stat().st_mtime_ns == when for path, when in kept.items())
    assert contents(resumed) == contents(demonstrations.record("random-goal", uninterrupted, "whole"))
    assert list(minari.list_local_datasets()) == ["killed-v0", "whole-v0"]
    assert [path.name for path in staging_folder().iterdir()] == [demonstrations.flights_folder().name]


def test_a_full_disk_is_named_and_the_older_dataset_unchanged(goals, contents):
    before = contents(demonstrations.record("random-goal", goals[:1]))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    try:
        with pytest.raises(OSError, match=r"older dataset of this name is unchanged; free some space.*best-known-v0'"):
            demonstrations.record("random-goal", goals, if_exists="replace")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert contents(minari.load_dataset("flatquad/random-goal/best-known-v0")) == before
    assert list(staging_folder().iterdir()) == []


def test_an_older_dataset_is_restored_if_the_new_one_cannot_replace_it(goals, monkeypatch, contents):
    before = contents(demonstrations.record("random-goal", goals[:1], "kept"))
    rename = Path.rename

    def refused(path, target):
        if path.name == "made":
            raise PermissionError(13, "Permission denied")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", refused)
    with pytest.raises(PermissionError, match="Permission denied; an older dataset"):
        demonstrations.record("random-goal", goals, "kept", if_exists="replace")
    assert contents(minari.load_dataset("kept-v0")) == before


def test_names_and_problems_that_minari_cannot_store_are_refused(goals):
    with pytest.raises(ValueError, match=r"letters, digits.* got 'my goals'"):
        demonstrations.record("random-goal", goals, "my goals")
    with pytest.raises(ValueError, match="no demonstrations of 'random-goal'"):
        demonstrations.record("random-goal", [])
    demonstrations.record("random-goal", goals, "a-v0/b-v0")
    with pytest.raises(ValueError, match="'a-v0' is a namespace of other datasets"):
        demonstrations.record("random-goal", goals, "a-v0")
