"""The results file of a suite: all cells and what they share; merging and selecting results."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from experiments.benchmark.conditions import CONDITIONS
from experiments.benchmark.suite import SMOKE_SUITE, Suite, cell_path
from experiments.files import Row, plain
from experiments.provenance import provenance
from flatgym.files import write_text


def collect(
    suite: Suite,
    cells: Sequence[Row],
    validation_k_star: Row,
    preparations: Mapping[str, Row],
    tasks: Row,
    command: str,
) -> Row:
    """Return the results of a suite.

    K* of the episodes is moved out of the cells: it is the same for all agents of a problem.

    Args:
        suite: the suite.
        cells: the rows of its cells.
        validation_k_star: by problem's label, K* of validation.
        preparations: by scenario's label, the result of `experiments.recipes.plans.preparation`.
        tasks: by label, the tasks of one's own, as `experiments.benchmark.tasks.own_tasks` returns them.
        command: the command line.
    """
    problems = list(dict.fromkeys(cell["problem"] for cell in cells))
    k_star: dict[str, list[float]] = {problem: [] for problem in problems}
    for cell in cells:
        k_star[cell["problem"]] = max(k_star[cell["problem"]], cell.get("k_star", []), key=len)
    return provenance(command) | {
        "suite": suite.name,
        "smoke": suite.name == SMOKE_SUITE,
        "conditions": {name: disturbances.active for name, disturbances in CONDITIONS.items()},
        "solutions": [row["solution"] for row in preparations.values()],
        "demonstrations": {name: row["demonstrated_steps"] for name, row in preparations.items()},
        "validation_k_star": {name: validation_k_star[name] for name in problems},
        "k_star": k_star,
        "tasks": tasks,
        "cells": [{key: value for key, value in cell.items() if key != "k_star"} for cell in cells],
    }


def write_results(path: Path, results: Row) -> None:
    """Write results as JSON, with a line for each value and each cell."""
    lines = [f" {json.dumps(key)}: {json.dumps(plain(value))}" for key, value in results.items() if key != "cells"]
    rows = ",\n".join(f"  {json.dumps(plain(cell))}" for cell in results["cells"])
    write_text(path, "{\n" + ",\n".join([*lines, f' "cells": [\n{rows}\n ]']) + "\n}\n")


def restore(results: Row, folder: Path) -> None:
    """Write the cells of results to a folder, for a run that continues them; cells that the folder has are kept."""
    folder.mkdir(parents=True, exist_ok=True)
    for cell in results["cells"]:
        path = cell_path(folder, cell["problem"], cell["agent"], cell["seed"])
        if not path.exists():
            row = cell | {"k_star": results["k_star"][cell["problem"]]}
            write_text(path, json.dumps(plain(row)) + "\n")


def merge(first: Row, *others: Row) -> Row:
    """Return results with the cells of others, for each problem and agent that the earlier ones lack."""
    cells = {(cell["problem"], cell["agent"], cell["seed"]): cell for cell in first["cells"]}
    k_star, validation_k_star = dict(first["k_star"]), dict(first["validation_k_star"])
    tasks = dict(first.get("tasks", {}))
    for other in others:
        agents = {(problem, agent) for problem, agent, _ in cells}
        for cell in other["cells"]:
            if (cell["problem"], cell["agent"]) not in agents:
                cells[cell["problem"], cell["agent"], cell["seed"]] = cell
        for problem, known in other["k_star"].items():
            k_star[problem] = max(known, k_star.get(problem, []), key=len)
        validation_k_star = other["validation_k_star"] | validation_k_star
        tasks = other.get("tasks", {}) | tasks
    shared = {"k_star": k_star, "validation_k_star": validation_k_star, "tasks": tasks}
    return first | shared | {"cells": list(cells.values())}


def select_problem(problem: str, results: Row) -> Row:
    """Return the part of results that is about one problem, given by its label."""
    cells = [cell for cell in results["cells"] if cell["problem"] == problem]
    shared = {
        key: {name: value for name, value in results.get(key, {}).items() if name == problem}
        for key in ("k_star", "validation_k_star", "tasks")
    }
    return results | shared | {"cells": cells}
