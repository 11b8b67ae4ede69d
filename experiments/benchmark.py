"""The benchmark: who flies what, how far from the optimum; PPO, SAC, BC, DAgger beside experts and a PD controller.

    results = run(SUITES["quick"], Path("experiments/results/benchmark"), command="...", bar=bar)

A suite is a set of cells, and a cell is a problem, an agent and a seed: one file, written whole when it is done. What
is done is not done again, so that a killed run goes on where it was, and ends with what it would have ended with.
Every policy flies undisturbed and under each disturbance, all of them on the same draws, which no training saw. What
fails is a cell too: it says why, and the others go on; the next run tries it again. All cells are joined into one
file, from which tables, plots and the report are made.
"""

from __future__ import annotations

import json
import shutil
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.progress import Progress
from stable_baselines3.common.base_class import BaseAlgorithm

import optimal
from agents import demonstrations, policies
from agents.adapters import adapted
from agents.evaluate import CALM, FasterThanOptimal, Policy, flight_rows, fly, versions
from agents.optima import optima
from experiments.files import SCHEMA, plain, read_json, write_json
from experiments.guard import Failed, guarded
from experiments.page.board import board
from experiments.provenance import now, provenance
from experiments.recipes import EXPERTS, FULL, LEARNERS, ONLY_SCENARIOS, Lesson, Made, Sizes, prepare
from flatgym import DISTRIBUTIONS, SCENARIOS
from flatgym.disturbances import Disturbances
from flatgym.reference import EVALUATION_SEED
from optimal.batch import unordered
from optimal.export import write_text

Row = dict[str, Any]
CONDITIONS = {
    "calm": CALM,
    "wind": Disturbances(wind=0.5),
    "mass": Disturbances(mass=0.05),
    "delay": Disturbances(action_delay=1),
    "together": Disturbances(wind=0.25, mass=0.025, action_delay=1),
}
"""What stands against the vehicle: nothing, one disturbance, or wind and mass at half strength with the delay."""
FIRST = ("bc", "bc-ppo")
"""The second begins with what the first gives."""
ALL = (*LEARNERS, *EXPERTS)
SEEDS = 3
TRIAL = "trial"
"""Name of a suite of small sizes, whose numbers mean nothing."""
COLUMNS = (
    "problem", "agent", "seeds", "condition", "success_rate", "success_low", "success_high", "gap", "gap_low",
    "gap_high", "env_steps", "learning_s", "error",
)  # fmt: skip
"""Columns of the table of scores."""
DEMONSTRATIONS = 6
"""Flights of a scenario that a suite records as a dataset."""
TIMEOUT = 300.0
"""How long the flights of a policy that is not ours may take [s]."""


@dataclass(frozen=True)
class Suite:
    """What a benchmark consists of.

    Attributes:
        name: what to call it.
        agents: who flies each problem, by the problem's name.
        seeds: trainings of each learner.
        sizes: how much of everything.
        prologue: whether scenarios are solved, and demonstrations of them recorded, before anything is learnt.
        policies: further agents, each a name and what `agents.adapted` is to load; they fly every problem.
        timeout: how long the flights of one of these may take [s].
    """

    name: str
    agents: Mapping[str, Sequence[str]]
    seeds: int = SEEDS
    sizes: Sizes = FULL
    prologue: bool = False
    policies: Mapping[str, str] = field(default_factory=dict)
    timeout: float = TIMEOUT

    def cells(self, only: Sequence[str] = ()) -> list[Cell]:
        """Return the cells in the order of the tables.

        Args:
            only: "problem" or "problem/agent", those asked for; nothing for all. What one begins with comes with it.

        Raises:
            ValueError: for what there is not, listing what there is.
        """
        found = [
            Cell(problem, agent, seed)
            for problem, agents in self.agents.items()
            for agent in (*agents, *self.policies)
            for seed in range(self.seeds if agent in LEARNERS else 1)
        ]
        names = {name for cell in found for name in (cell.problem, f"{cell.problem}/{cell.agent}")}
        if unknown := sorted(set(only) - names):
            raise ValueError(f"unknown cells {', '.join(unknown)}; known: {', '.join(sorted(names))}")
        first, then = FIRST
        wanted = set(only) | {name.replace(then, first) for name in only if name.endswith(then)}
        return [cell for cell in found if not only or {cell.problem, f"{cell.problem}/{cell.agent}"} & wanted]


@dataclass(frozen=True)
class Cell:
    """One file of a benchmark."""

    problem: str
    agent: str
    seed: int

    def path(self, folder: Path) -> Path:
        """Return its file."""
        return folder / f"{self.problem}-{self.agent}-{self.seed}.json"

    def read(self, folder: Path) -> Row | None:
        """Return what stands in its file; None where there is none that can be read."""
        return read_json(self.path(folder))


def everybody(problems: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return all agents for each problem, without those that cannot fly it."""
    return {name: tuple(agent for agent in ALL if can_fly(agent, name)) for name in problems}


def can_fly(agent: str, problem: str) -> bool:
    """Return whether an agent knows how to fly a problem: a policy that came with the package flies its own only."""
    if agent == "pretrained":
        return problem in policies.names()
    return not (agent in ONLY_SCENARIOS and problem in DISTRIBUTIONS)


SUITES = {
    suite.name: suite
    for suite in (
        Suite(
            "quick",
            {
                "hoop": ("ppo", "dagger", "pretrained", "expert", "tape", "pd"),
                "horizontal-6": ("ppo", "pretrained", "pd"),
                "random-goal": ("pretrained", "pd"),
            },
            seeds=1,
            sizes=replace(FULL, seconds=250.0, ppo_steps=5_000_000),
            prologue=True,
        ),
        Suite("full", everybody([*SCENARIOS, *DISTRIBUTIONS]), prologue=True),
        Suite("study", {name: tuple(a for a in who if a != "pretrained")
                        for name, who in everybody(["hoop", "random-goal"]).items()}),
    )
}  # fmt: skip
"""What can be run: in minutes, in hours, and the comparison of the learners that the README prints."""


def run(
    suite: Suite,
    folder: Path,
    *,
    command: str,
    bar: Progress,
    only: Sequence[str] = (),
    jobs: int = -1,
    backend: str = "loky",
) -> Row:
    """Run what is not done yet, join all that is into a file beside the folder, and return what it holds.

    Args:
        suite: what to run.
        folder: of the cells; the joined file has its name and the ending .json.
        command: what the user typed, for the record.
        bar: shows how far the work is.
        only: as in `Suite.cells`.
        jobs: cells at a time; -1 is one for each core.
        backend: "loky" for processes of this machine, "ray" for a Ray cluster that shares the folder.

    Raises:
        ValueError: for unknown cells.
    """
    wanted, folder = suite.cells(only), folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    everything = replace(suite, seeds=max(suite.seeds, SEEDS)).cells()
    found = {cell: words for cell in everything if (words := cell.read(folder)) is not None}
    # A policy that is not ours may be another by now, and is flown anew.
    left = [c for c in wanted if c not in found or found[c].get("error") or c.agent in suite.policies]
    problems = [name for name in suite.agents if any(cell.problem == name for cell in (*wanted, *found))]
    k_check, prologues = {}, {}
    planning = bar.add_task("optima, demonstrations", total=len(problems), note="")
    for problem in problems:
        bar.update(planning, note=problem)
        asked = {cell.agent for cell in left if cell.problem == problem}
        k_check[problem] = prepare(Lesson(problem, 0, folder, suite.sizes), asked)
        if suite.prologue and problem in SCENARIOS:
            prologues[problem] = prologue(problem, folder)
        bar.advance(planning)
    work, failures = bar.add_task("cells", total=len(left), note=""), 0
    for wave in ([c for c in left if c.agent != FIRST[1]], [c for c in left if c.agent == FIRST[1]]):
        tasks = [(suite, cell, folder, Path.cwd()) for cell in sorted(wave, key=longest)]
        for cell in unordered(_fly, tasks, jobs, backend) if tasks else ():  # type: ignore[arg-type]
            found[cell] = cell.read(folder) or failed(cell, folder, "it left no file")
            error = found[cell].get("error")
            failures += bool(error)
            note = f"{cell.problem}/{cell.agent} " + (f"failed: {error}" if error else "done")
            bar.update(work, note=note[:60] + (f" ({failures} failed)" if failures else ""))
            bar.advance(work)
    done = [found[cell] for cell in everything if cell in found]
    results = joined(suite, done, k_check, prologues, command)
    write(folder.with_suffix(".json"), results)
    return results


def longest(cell: Cell) -> int:
    """Return the place in the queue: what trains longest begins first, so that no core waits for it alone."""
    return list(ALL).index(cell.agent) if cell.agent in ALL else len(ALL)


def _fly(task: tuple[Suite, Cell, Path, Path]) -> Cell:
    suite, cell, folder, home = task  # a worker that served before may be at home elsewhere
    if cell.agent not in suite.policies:
        make(cell, folder, suite.sizes)
        return cell
    try:
        arguments = asdict(cell), str(folder), asdict(suite.sizes), suite.policies[cell.agent]
        guarded("experiments.benchmark:foreign", *arguments, seconds=suite.timeout, home=home)
    except Failed as error:
        failed(cell, folder, str(error))
    return cell


def foreign(cell: Row, folder: str, sizes: Row, policy: str) -> None:
    """Make a cell of a policy that is not ours; all arguments as JSON holds them."""
    make(Cell(**cell), Path(folder), Sizes(**sizes), policy)


def make(cell: Cell, folder: Path, sizes: Sizes, policy: str = "") -> None:
    """Make an agent, or load a policy that is not ours, let it fly, and write its cell; or why it could not."""
    lesson = Lesson(cell.problem, cell.seed, folder, sizes)
    try:
        made = Made(adapted(policy, trust=True), policy) if policy else (LEARNERS | EXPERTS)[cell.agent](lesson)
        if isinstance(made.policy, BaseAlgorithm) and cell.agent in LEARNERS:
            policies.save(made.policy, lesson.file(cell.agent, ".zip"), cell.problem)
        words = told(cell, made) | flown(made.policy, lesson, cell.agent)
    except FasterThanOptimal as error:
        evidence = {"scenario": error.scenario.to_dict(), "k_star": error.k_star, "actions": error.actions}
        write_json(lesson.file(cell.agent, ".faster.json"), evidence)
        failed(cell, folder, f"FasterThanOptimal: {error}")
    except Exception as error:  # one cell must not end the others
        failed(cell, folder, f"{type(error).__name__}: {error}")
    else:
        write_text(cell.path(folder), json.dumps(plain(words)) + "\n")
        shutil.rmtree(lesson.file(cell.agent, ""), ignore_errors=True)


def failed(cell: Cell, folder: Path, error: str) -> Row:
    """Write a cell that says why there is nothing in it, and return it."""
    words = {"schema": SCHEMA, **asdict(cell), "date": now(), "versions": versions(), "error": error, "flights": {}}
    write_text(cell.path(folder), json.dumps(plain(words)) + "\n")
    return words


def told(cell: Cell, made: Made) -> Row:
    """Return what is to be known of an agent besides its flights."""
    return {
        "schema": SCHEMA,
        **asdict(cell),
        "algorithm": made.algorithm,
        "configs": [{"kind": type(config).__name__} | asdict(config) for config in made.configs],
        "date": now(),
        "versions": versions(),
        "env_steps": made.env_steps,
        "expert_steps": made.expert_steps,
        "wall_time_s": round(made.wall_time_s, 1),
        "planning_s": round(made.planning_s, 2),
        "curve": list(made.curve),
    }


def flown(policy: Policy, lesson: Lesson, agent: str) -> Row:
    """Let a policy fly under all conditions.

    Returns:
        The "flights" of each condition, with outcomes and each flight's steps, None where it failed; and on a scenario
        the "actions" of the undisturbed one.
    """
    found = {}
    for name, disturbances in CONDITIONS.items():
        begun = time.perf_counter()
        episodes = flights_of(lesson, agent, name == "calm")
        rows = flight_rows(policy, lesson.problem, episodes, EVALUATION_SEED, disturbances=disturbances)
        reached = rows["outcome"] == "goal"
        found[name] = {
            "outcomes": dict(Counter(rows["outcome"])),
            "steps": [int(steps) if there else None for steps, there in zip(rows["steps"], reached, strict=True)],
            "seconds": round(time.perf_counter() - begun, 2),
        }
    if lesson.drawn:
        return {"flights": found}
    actions = fly(policy, lesson.problem, 1, EVALUATION_SEED).actions[0]
    return {"flights": found, "actions": [[float(str(value)) for value in row] for row in actions]}  # as short as exact


def flights_of(lesson: Lesson, agent: str, calm: bool) -> int:
    """Return how many flights an agent flies: one tells all of a deterministic policy on an undisturbed scenario."""
    sizes = lesson.sizes
    if calm and not lesson.drawn:
        return 1
    if agent == "replanner":
        return sizes.replanned
    return sizes.goals if calm and agent not in ("expert", "tape") else sizes.disturbed


def prologue(problem: str, folder: Path) -> Row:
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


def joined(suite: Suite, done: Sequence[Row], k_check: Row, prologues: Mapping[str, Row], command: str) -> Row:
    """Return all cells and what they share: K* of the flights scored, and of those that learning curves are made of."""
    problems = list(dict.fromkeys(cell["problem"] for cell in done))

    def flights(problem: str) -> Iterator[int]:
        yield 1
        yield from (len(f["steps"]) for c in done if c["problem"] == problem for f in c["flights"].values())

    return provenance(command) | {
        "suite": suite.name,
        "quick": suite.name == TRIAL,
        "conditions": {name: disturbances.active for name, disturbances in CONDITIONS.items()},
        "solutions": [words["solution"] for words in prologues.values()],
        "demonstrations": {name: words["demonstrated_steps"] for name, words in prologues.items()},
        "k_check": {name: k_check[name] for name in problems},
        "k_star": {name: optima(name, EVALUATION_SEED + np.arange(max(flights(name)))).k_star for name in problems},
        "cells": done,
    }


def write(path: Path, results: Row) -> None:
    """Write the results, a line for each value and each cell."""
    lines = [f" {json.dumps(key)}: {json.dumps(plain(value))}" for key, value in results.items() if key != "cells"]
    rows = ",\n".join(f"  {json.dumps(plain(cell))}" for cell in results["cells"])
    write_text(path, "{\n" + ",\n".join([*lines, f' "cells": [\n{rows}\n ]']) + "\n}\n")


def scores(results: Row) -> pd.DataFrame:
    """Return one row for each problem, agent and condition: success and gap, their intervals, cost; and each error."""
    found = board(results)
    lines = {(line.problem, line.agent): line for line in found.lines}
    rows: list[Row] = []
    for one in found.standings:
        line = lines[one.problem, one.agent]
        rates = {"success_rate" if key == "success" else key: value for key, value in asdict(one).items()}
        rows.append(
            rates | {"seeds": line.runs, "env_steps": line.env_steps, "learning_s": line.learning_s, "error": ""}
        )
    for line in found.lines:
        shared = {"problem": line.problem, "agent": line.agent, "condition": "calm"}
        rows += [shared | {"error": words} for words in line.errors]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def merged(first: Row, *others: Row) -> Row:
    """Return results with the cells of others that they do not have themselves."""
    cells = {(cell["problem"], cell["agent"], cell["seed"]): cell for cell in first["cells"]}
    k_star, k_check = dict(first["k_star"]), dict(first["k_check"])
    for other in others:
        agents = {(problem, agent) for problem, agent, _ in cells}
        for cell in other["cells"]:
            if (cell["problem"], cell["agent"]) not in agents:
                cells[cell["problem"], cell["agent"], cell["seed"]] = cell
        for problem, known in other["k_star"].items():
            k_star[problem] = max(known, k_star.get(problem, []), key=len)
        k_check = other["k_check"] | k_check
    return first | {"k_star": k_star, "k_check": k_check, "cells": list(cells.values())}


def only(problem: str, results: Row) -> Row:
    """Return what results hold of one problem."""
    cells = [cell for cell in results["cells"] if cell["problem"] == problem]
    kept = {
        key: {name: value for name, value in results[key].items() if name == problem} for key in ("k_star", "k_check")
    }
    return results | kept | {"cells": cells}
