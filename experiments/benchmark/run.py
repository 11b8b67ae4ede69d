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
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from rich.progress import Progress
from stable_baselines3.common.base_class import BaseAlgorithm

from agents import policies
from agents.evaluation.scores import FasterThanOptimal
from agents.evaluation.versions import versions
from agents.policies.adapters import load_policy
from experiments.benchmark.conditions import flown
from experiments.benchmark.results import joined, write
from experiments.benchmark.sandbox import Failed, run_isolated
from experiments.benchmark.suite import ALL, FIRST, SEEDS, Cell, Suite
from experiments.files import SCHEMA, Row, plain, write_json
from experiments.provenance import now
from experiments.recipes.lesson import Budget, RunSpec, TrainedAgent
from experiments.recipes.plans import preparation
from experiments.recipes.registry import EXPERTS, LEARNERS, prepare
from flatgym import SCENARIOS
from flatgym.files import write_text
from optimal.parallel import unordered


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
        k_check[problem] = prepare(RunSpec(problem, 0, folder, suite.sizes), asked)
        if suite.preparation and problem in SCENARIOS:
            prologues[problem] = preparation(problem, folder)
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
        run_isolated("experiments.benchmark.run:foreign", *arguments, seconds=suite.timeout, home=home)
    except Failed as error:
        failed(cell, folder, str(error))
    return cell


def foreign(cell: Row, folder: str, sizes: Row, policy: str) -> None:
    """Make a cell of a policy that is not ours; all arguments as JSON holds them."""
    make(Cell(**cell), Path(folder), Budget(**sizes), policy)


def make(cell: Cell, folder: Path, sizes: Budget, policy: str = "") -> None:
    """Make an agent, or load a policy that is not ours, let it fly, and write its cell; or why it could not."""
    lesson = RunSpec(cell.problem, cell.seed, folder, sizes)
    try:
        made = (
            TrainedAgent(load_policy(policy, trust=True), policy)
            if policy
            else (LEARNERS | EXPERTS)[cell.agent](lesson)
        )
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


def told(cell: Cell, made: TrainedAgent) -> Row:
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
