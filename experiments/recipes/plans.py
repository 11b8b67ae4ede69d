"""Optimal flights planned before training: demonstrations of a scenario, and flights of sampled scenarios."""

from __future__ import annotations

import json
import time

import optimal
from agents import demonstrations
from experiments.files import SCHEMA, Row, read_json, write_json
from experiments.recipes.margins import HOOP_SHARE
from experiments.recipes.run_spec import RunSpec
from flatgym.scenarios.distributions import Distribution
from optimal.batch import fewest_steps_many
from optimal.discrete.fewest_steps import FewestSteps

RECORDED_FLIGHTS = 6
"""Flights of a scenario that a suite records as a dataset."""
BATCH_SIZE = 250
"""Flights planned at once. An interrupted run keeps the flights of its last batch, but not their planning time."""


def preparation(spec: RunSpec) -> Row:
    """Solve a scenario and record demonstrations of it, once; return "solution", "dataset" and "demonstrated_steps".

    The result is stored in the folder of the run, and read from there on the next call.
    """
    path, problem = spec.folder / f"{spec.label}.preparation.json", spec.problem
    if (row := read_json(path)) is None:
        solution = optimal.solve(problem)
        flights = demonstrations.plan(problem, RECORDED_FLIGHTS, seed=0, jobs=1)
        own = demonstrations.dataset_id(problem).replace("best-known", "benchmark")  # one that the user recorded stays
        dataset = demonstrations.record(problem, flights, own, if_exists="replace")
        row = {"schema": SCHEMA, "solution": solution.row(), "dataset": dataset.id}
        row["demonstrated_steps"] = [flight.steps for flight in flights]
        write_json(path, row)
    return row


def plan_flights(spec: RunSpec, first: int, count: int, share: float = HOOP_SHARE) -> tuple[list[FewestSteps], float]:
    """Return optimal flights of sampled scenarios and the time their planning took [s].

    Flights are planned once, on all cores, and stored in the folder of the run, as is the planning time.

    Args:
        spec: a run on a distribution.
        first: seed of the first scenario.
        count: number of scenarios, of consecutive seeds.
        share: of the hoops' free width, as in `Scenario.narrowed`.

    Raises:
        ValueError: where a scenario has no flight; all of them need one.
    """
    flights, seconds, target = [], 0.0, spec.target
    assert isinstance(target, Distribution)
    store = spec.folder / "flights"
    for begin in range(first, first + count, BATCH_SIZE):
        seeds = range(begin, min(begin + BATCH_SIZE, first + count))
        record = spec.folder / f"planned-{spec.label}-{seeds.start}-{seeds.stop}.json"
        jobs, began = 1 if record.exists() else -1, time.perf_counter()
        scenarios = [target.scenario(i).narrowed(share) for i in seeds]
        flights += fewest_steps_many(scenarios, jobs=jobs, store=store, progress=False)
        if not record.exists():
            write_json(record, {"planning_s": time.perf_counter() - began})
        seconds += json.loads(record.read_text(encoding="utf-8"))["planning_s"]
    missing = [flight.scenario.name for flight in flights if not len(flight.actions)]
    if missing:
        raise ValueError(f"no flight was found for {', '.join(missing)}; every scenario of the study needs one")
    return flights, seconds
