"""TODO experiments/recipes/plans.py."""

from __future__ import annotations

import json
import time
from pathlib import Path

import optimal
from agents import demonstrations
from experiments.files import SCHEMA, Row, read_json, write_json
from experiments.recipes.lesson import RunSpec
from experiments.recipes.margins import INNER, inner
from flatgym.scenarios.distributions import Distribution
from optimal.batch import fewest_steps_many
from optimal.discrete.fewest_steps import FewestSteps

DEMONSTRATIONS = 6
"""Flights of a scenario that a suite records as a dataset."""


def preparation(problem: str, folder: Path) -> Row:
    """Solve a scenario, record demonstrations of it, and return what came of both; once, then from a file."""
    path = folder / f"{problem}.prologue.json"
    if (words := read_json(path)) is None:
        solution = optimal.solve(problem)
        planned = demonstrations.plan(problem, DEMONSTRATIONS, seed=0, jobs=1)
        dataset = demonstrations.record(problem, planned)
        words = {"schema": SCHEMA, "solution": solution.row(), "dataset": dataset.id}
        words["demonstrated_steps"] = [one.steps for one in planned]
        write_json(path, words)
    return words


BATCH = 250
"""Flights planned at once; what a killed run has planned of a batch is kept, but its time is not."""


def plans(lesson: RunSpec, first: int, count: int, share: float = INNER) -> tuple[list[FewestSteps], float]:
    """Return optimal flights of `count` drawn scenarios from seed `first` on, and the time their planning took [s].

    They are planned once, on all cores, through that share of their hoops; a file beside them says how long it took.
    """
    flights, taken, target = [], 0.0, lesson.target
    assert isinstance(target, Distribution)
    store = lesson.folder / "flights"
    for begin in range(first, first + count, BATCH):
        seeds = range(begin, min(begin + BATCH, first + count))
        record = lesson.folder / f"planned-{lesson.problem}-{seeds.start}-{seeds.stop}.json"
        jobs, begun = 1 if record.exists() else -1, time.perf_counter()
        drawn = [inner(target.scenario(i), share) for i in seeds]
        flights += fewest_steps_many(drawn, jobs=jobs, store=store, progress=False)
        if not record.exists():
            write_json(record, {"planning_s": time.perf_counter() - begun})
        taken += json.loads(record.read_text(encoding="utf-8"))["planning_s"]
    lost = [flight.scenario.name for flight in flights if not len(flight.actions)]
    if lost:
        raise ValueError(f"no flight was found for {', '.join(lost)}; every scenario of the study needs one")
    return flights, taken
