"""Measurements of the demonstrations: flights per second, their quality, and whether each replays to the goal.

    flatquad measure demonstrations [SECTION]... [--quick] [--out FILE]

Wall times include starting the workers, building their programs, storing each flight, replaying all flights in the
environment, and writing the dataset.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from agents import demonstrations
from agents.demonstrations.verification import Replay
from experiments.files import Row
from experiments.measurements.sections import Advance, Section

JOBS = 2
GOALS, HOOPS, PERTURBED = 1000, 100, 200
"""Flights of `random-goal`, of `random-hoops`, and of `random-goal` with one perturbed copy each."""


def random_goal(quick: bool, advance: Advance) -> list[Row]:
    """How many flights of `random-goal` a second are planned and recorded, and do all of them replay?"""
    return [record_row("random-goal", 4 if quick else GOALS, 0, advance)]


def random_hoops(quick: bool, advance: Advance) -> list[Row]:
    """The same for `random-hoops`."""
    return [record_row("random-hoops", 1 if quick else HOOPS, 0, advance)]


def perturbed(quick: bool, advance: Advance) -> list[Row]:
    """The same for `random-goal`, each flight also perturbed once and replanned."""
    return [record_row("random-goal", 2 if quick else PERTURBED, 1, advance)]


def record_row(name: str, episodes: int, copies: int, advance: Advance) -> Row:
    """Plan, record and replay flights in a temporary folder; return times and counts."""
    with _temporary_datasets() as folder:
        begun = time.perf_counter()
        flights = demonstrations.plan(
            name, episodes, perturbed=copies, jobs=JOBS, store=demonstrations.flights_folder(), progress=advance
        )
        planned = time.perf_counter()
        dataset = demonstrations.record(name, flights)
        recorded = time.perf_counter()
        replays = demonstrations.replay(dataset)
        size = sum(path.stat().st_size for path in folder.rglob("*.hdf5"))
    return {
        "what": name,
        "flights": len(flights),
        "perturbed": sum(one.options is not None for one in flights),
        "processes": JOBS,
        "planning_s": planned - begun,
        "recording_s": recorded - planned,
        "per_second": len(flights) / (recorded - begun),
        "statuses": dict(Counter(one.flight.status.value for one in flights)),
        "proven": sum(one.flight.proven for one in flights) / len(flights),
        "mean_steps": sum(one.steps for one in flights) / len(flights),
        "replayed_to_goal": sum(map(_reaches_goal, replays)) / len(flights),
        "bytes_per_flight": size / len(flights),
    }


def _reaches_goal(replay: Replay) -> bool:
    return replay.outcome == "goal" and replay.steps == replay.k_star


@contextmanager
def _temporary_datasets() -> Iterator[Path]:
    """Let Minari use a temporary folder, which holds no earlier datasets."""
    name = "MINARI_DATASETS_PATH"
    before = os.environ.get(name)
    with tempfile.TemporaryDirectory() as folder:
        os.environ[name] = folder
        try:
            yield Path(folder)
        finally:
            del os.environ[name]
            if before is not None:
                os.environ[name] = before


SECTIONS: dict[str, Section] = {
    "random-goal": random_goal,
    "random-hoops": random_hoops,
    "perturbed": perturbed,
}
"""The sections by name."""
