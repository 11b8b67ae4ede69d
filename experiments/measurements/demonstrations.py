"""The demonstrations' benchmark: how many flights a second, how good, and whether every one replays to the goal.

    python -m experiments.measurements.demonstrations

Wall times count everything from the order to the dataset on disk: starting the workers, building their programs,
keeping each flight in the store, flying all in the environment and writing them.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from agents import demonstrations
from agents.demonstrations.recording import Replay
from experiments.files import Row
from experiments.measurements import sections
from experiments.measurements.sections import Advance, Section

JOBS = 2
GOALS, HOOPS, KNOCKED = 1000, 100, 200
"""Flights to random goals, through random hoops, and to random goals with a continuation each."""


def random_goal(quick: bool, advance: Advance) -> list[Row]:
    """How many flights to random goals a second are planned and recorded, and do all of them replay?"""
    return [measured("random-goal", 4 if quick else GOALS, 0, advance)]


def random_hoops(quick: bool, advance: Advance) -> list[Row]:
    """The same through random hoops."""
    return [measured("random-hoops", 1 if quick else HOOPS, 0, advance)]


def continuations(quick: bool, advance: Advance) -> list[Row]:
    """The same to random goals, each flight knocked off once on its way and planned anew."""
    return [measured("random-goal", 2 if quick else KNOCKED, 1, advance)]


def measured(name: str, episodes: int, perturbed: int, advance: Advance) -> Row:
    """Plan, record and replay in a folder of its own; return the figures."""
    with _own_folder() as folder:
        begun = time.perf_counter()
        flights = demonstrations.plan(
            name, episodes, perturbed=perturbed, jobs=JOBS, store=demonstrations.flights_folder(), progress=advance
        )
        planned = time.perf_counter()
        dataset = demonstrations.record(name, flights)
        recorded = time.perf_counter()
        replays = demonstrations.replay(dataset)
        size = sum(path.stat().st_size for path in folder.rglob("*.hdf5"))
    return {
        "what": name,
        "flights": len(flights),
        "continued": sum(one.options is not None for one in flights),
        "processes": JOBS,
        "planning_s": planned - begun,
        "recording_s": recorded - planned,
        "per_second": len(flights) / (recorded - begun),
        "statuses": dict(Counter(one.flight.status.value for one in flights)),
        "proven": sum(one.flight.proven for one in flights) / len(flights),
        "mean_steps": sum(one.steps for one in flights) / len(flights),
        "replayed_to_goal": sum(map(_succeeded, replays)) / len(flights),
        "bytes_per_flight": size / len(flights),
    }


def _succeeded(replay: Replay) -> bool:
    return replay.outcome == "goal" and replay.steps == replay.k_star


@contextmanager
def _own_folder() -> Iterator[Path]:
    """Have Minari keep its datasets in a temporary folder for a while, so that nothing is found there already."""
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
    "continuations": continuations,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the script; see the module's docstring."""
    out = Path("experiments/results/demos.json")
    sections.main("experiments.measurements.demonstrations", __doc__ or "", SECTIONS, out, arguments)


if __name__ == "__main__":
    main()
