"""The benchmark runner: trains, flies and scores every cell of a suite.

    results = run(SUITES["quick"], Path("experiments/results/benchmark"), command="...", bar=bar)

A cell is a problem, an agent and a seed, with a file of its own. Finished cells are skipped, so an interrupted run
resumes and gives the same result. A cell that fails stores its error, the others continue, and the next run tries it
again. All policies fly the same evaluation episodes, nominal and disturbed, which are unseen in training. The cells are
collected in one file, the source of tables, plots and the report.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from rich.progress import Progress
from stable_baselines3.common.base_class import BaseAlgorithm

from agents import policies
from agents.evaluation.scores import FasterThanOptimal
from agents.evaluation.validation import milestones
from agents.evaluation.versions import versions
from agents.policies.adapters import load_policy, statistics_of
from agents.policies.fingerprint import fingerprint
from experiments.benchmark.conditions import fly_conditions
from experiments.benchmark.results import collect, write_results
from experiments.benchmark.suite import AGENTS, PREREQUISITES, SEEDS, Cell, Suite
from experiments.benchmark.summary import TARGET_SUCCESS
from experiments.benchmark.tasks import own_tasks
from experiments.files import SCHEMA, Row, plain, write_json
from experiments.provenance import now, processor
from experiments.recipes.plans import preparation
from experiments.recipes.registry import EXPERTS, LEARNERS, prepare
from experiments.recipes.run_spec import Budget, RunSpec, TrainedAgent
from experiments.sandbox import Failed, run_isolated
from flatgym.files import write_text
from flatgym.scenarios.catalogue import label
from optimal.parallel import unordered

NO_FILE = "it left no file; the machines of a cluster must share the folder of the results"
"""The error of a cell that another machine has written elsewhere."""
Task = tuple[Suite, Cell, Path, Path]
"""A suite, one of its cells, the folder of the cells, and the working directory of the caller."""


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
    """Run the unfinished cells of a suite, collect all finished ones in a file, and return its content.

    Args:
        suite: the suite.
        folder: of the cells; the collected file has its name and the suffix .json.
        command: the command line, for the record.
        bar: shows the progress.
        only: as in `Suite.cells`.
        jobs: cells at a time; -1 is one for each core.
        backend: "loky" for processes of this machine, "ray" for a Ray cluster that shares the folder.

    Raises:
        ValueError: for unknown cells.
    """
    wanted, folder = suite.cells(only), folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    everything = replace(suite, seeds=max(suite.seeds, SEEDS)).cells()
    done = {cell: row for cell in everything if (row := cell.read(folder)) is not None}
    # External policies always fly again: their code may have changed.
    left = [c for c in wanted if c not in done or done[c].get("error") or c.agent in suite.policies]
    problems = [name for name in suite.agents if any(cell.problem == name for cell in (*wanted, *done))]
    validation_k_star, preparations = plan_all(suite, folder, problems, left, bar)
    progress, failures = bar.add_task("cells", total=len(left), note=""), 0
    for wave in ([c for c in left if c.agent not in PREREQUISITES], [c for c in left if c.agent in PREREQUISITES]):
        tasks = [(suite, cell, folder, Path.cwd()) for cell in sorted(wave, key=queue_position)]
        for cell in unordered(run_task, tasks, jobs, backend) if tasks else ():  # type: ignore[arg-type]
            done[cell] = cell.read(folder) or write_failure(cell, folder, NO_FILE)
            error = done[cell].get("error")
            failures += bool(error)
            note = f"{cell.name} " + (f"failed: {error}" if error else "done")
            bar.update(progress, note=note[:60] + (f" ({failures} failed)" if failures else ""))
            bar.advance(progress)
    rows = [done[cell] for cell in everything if cell in done]
    results = collect(suite, rows, validation_k_star, preparations, own_tasks(problems), command)
    write_results(folder.with_suffix(".json"), results)
    return results


def plan_all(
    suite: Suite, folder: Path, problems: Sequence[str], left: Sequence[Cell], bar: Progress
) -> tuple[dict[str, float], dict[str, Row]]:
    """Plan the flights that unfinished cells need; return K* of validation and the preparations, by problem."""
    validation_k_star, preparations = {}, {}
    progress = bar.add_task("optima, demonstrations", total=len(problems), note="")
    for problem in problems:
        bar.update(progress, note=label(problem))
        agents = {cell.agent for cell in left if cell.problem == problem}
        spec = RunSpec(problem, 0, folder, suite.budget)
        validation_k_star[spec.label] = prepare(spec, agents)
        if suite.preparation and not spec.is_distribution:
            preparations[spec.label] = preparation(spec)
        bar.advance(progress)
    return validation_k_star, preparations


def queue_position(cell: Cell) -> int:
    """Return the position in the queue: the longest trainings start first, to balance the load of the cores."""
    return list(AGENTS).index(cell.agent) if cell.agent in AGENTS else len(AGENTS)


def run_task(task: Task) -> Cell:
    """Run a cell in a worker process, an external policy in a process of its own, and return the cell."""
    suite, cell, folder, home = task  # a reused worker may have another working directory
    if cell.agent not in suite.policies:
        run_cell(cell, folder, suite.budget, lambda spec: (LEARNERS | EXPERTS)[cell.agent](spec))
        return cell
    try:
        arguments = asdict(cell), str(folder), asdict(suite.budget), suite.policies[cell.agent]
        run_isolated("experiments.benchmark.run:run_external_cell", *arguments, seconds=suite.timeout, home=home)
    except Failed as error:
        write_failure(cell, folder, str(error))
    return cell


def run_external_cell(cell: Row, folder: str, budget: Row, policy: Row) -> None:
    """Run the cell of an external policy; all arguments as JSON holds them."""

    def recipe(_: RunSpec) -> TrainedAgent:
        loaded = load_policy(**policy)
        return TrainedAgent(loaded, policy["name"], fingerprint=fingerprint(policy["name"], statistics_of(loaded)))

    run_cell(Cell(**cell), Path(folder), Budget(**budget), recipe)


def run_cell(cell: Cell, folder: Path, budget: Budget, recipe: Callable[[RunSpec], TrainedAgent]) -> None:
    """Train or load an agent, fly it, and write its cell; on failure the cell holds the error."""
    spec = RunSpec(cell.problem, cell.seed, folder, budget)
    try:
        agent = recipe(spec)
        if isinstance(agent.policy, BaseAlgorithm) and cell.agent in LEARNERS:
            path = policies.save(agent.policy, spec.file(cell.agent, ".zip"), cell.problem)
            agent = replace(agent, fingerprint=fingerprint(path))
        row = training_row(cell, agent) | fly_conditions(agent.policy, spec, cell.agent)
    except FasterThanOptimal as error:
        evidence = {"scenario": error.scenario.to_dict(), "k_star": error.k_star, "actions": error.actions}
        write_json(spec.file(cell.agent, ".faster.json"), evidence)
        write_failure(cell, folder, f"FasterThanOptimal: {error}")
    except Exception as error:  # a failing cell must not end the others
        write_failure(cell, folder, f"{type(error).__name__}: {error}")
    else:
        write_text(cell.path(folder), json.dumps(plain(row)) + "\n")
        shutil.rmtree(spec.file(cell.agent, ""), ignore_errors=True)


def write_failure(cell: Cell, folder: Path, error: str) -> Row:
    """Write the cell of a failed agent, with its error and no episodes, and return it."""
    row = {"schema": SCHEMA, **cell.row, "date": now(), "versions": versions(), "error": error, "episodes": {}}
    write_text(cell.path(folder), json.dumps(plain(row)) + "\n")
    return row


def training_row(cell: Cell, agent: TrainedAgent) -> Row:
    """Return the part of a cell that does not depend on its episodes: how the agent was trained, and the cost."""
    return {
        "schema": SCHEMA,
        **cell.row,
        "algorithm": agent.algorithm,
        "configs": [{"kind": type(config).__name__} | asdict(config) for config in agent.configs],
        "date": now(),
        "versions": versions(),
        "processor": processor(),
        "env_steps": agent.env_steps,
        "expert_labels": agent.expert_labels,
        "training_s": round(agent.training_s, 1),
        "planning_s": round(agent.planning_s, 2),
        "fingerprint": agent.fingerprint,
        "curve": milestones(agent.curve, TARGET_SUCCESS),
    }
