"""TODO experiments/benchmark/results.py."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from agents.evaluation.optima import optima
from experiments.benchmark.conditions import CONDITIONS
from experiments.benchmark.suite import TRIAL, Suite
from experiments.files import Row, plain
from experiments.provenance import provenance
from flatgym.files import write_text
from flatgym.scenarios.reference import EVALUATION_SEED


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
