"""Write `flatgym/scenarios/reference.json`: the best-known solutions of the named scenarios.

K* and its flight are searched anew; T* and the bounds, which take minutes, are those published in `solvers.json`.
A K* that differs from the published one is refused: one of the two is out of date. Of the drawn scenarios that
scores are flown on, K* is searched and proven here, and kept one by one: a run that was broken off goes on.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import optimal
from agents.evaluation.versions import versions
from experiments.files import RESULTS, ROOT, published, write_json
from flatgym import DISTRIBUTIONS, SCENARIOS
from flatgym.scenarios.reference import EVALUATION_SEED, FILE, SCHEMA

COMMAND = "python -m experiments.measurements.reference_table"
DRAWS = {"random-goal": 1000, "random-hoops": 300}
"""How many scenarios of each distribution are known."""
PROOF = 10.0
"""Time granted for the proof of each K* [s]; a goal takes about 0.3, hoops about 6."""


def row(name: str) -> dict[str, Any]:
    """Return what is known of a named scenario, with actions that float32 reads back exactly.

    Raises:
        ValueError: where the search and `solvers.json` disagree about K*.
    """
    steps, bounds = (_published(section, name) for section in ("steps", "bounds"))
    found = optimal.fewest_steps(name, time_budget=0)
    if found.steps != steps["k_star"]:
        raise ValueError(
            f"{name}: a flight in {found.steps:g} steps was found, but solvers.json has K* = {steps['k_star']}; run "
            f"python -m experiments.measurements.solvers --section steps, and publish it"
        )
    return {
        "scenario": name,
        "k_star": steps["k_star"],
        "k_lower_bound": steps["lower_bound"],
        "proven": steps["proven"],
        "time_s": bounds["flown_s"],
        "time_lower_bound_s": bounds["lower_bound_s"],
        "winding": found.winding,
        "actions": shortest(found.actions),
    }


def drawn(name: str, number: int, *, store: Path | None = None, jobs: int = -1) -> dict[str, Any]:
    """Return what is known of the first scenarios of a distribution from EVALUATION_SEED on.

    Raises:
        ValueError: naming a scenario for which no flight was found.
    """
    scenarios = [DISTRIBUTIONS[name].scenario(EVALUATION_SEED + i) for i in range(number)]
    answers = optimal.fewest_steps_many(scenarios, time_budget=PROOF, store=store, jobs=jobs)
    for answer in answers:
        if not math.isfinite(answer.steps):
            raise ValueError(f"{answer.scenario.name}: no flight was found: {answer.reason}")
    return {
        "first_seed": EVALUATION_SEED,
        "k_star": [int(answer.steps) for answer in answers],
        "k_lower_bound": [answer.lower_bound for answer in answers],
    }


def shortest(values: NDArray[np.float32]) -> list[list[float]]:
    """Return float32 numbers with the fewest digits that read back the same, shape (n, m)."""
    return [[float(str(value)) for value in line] for line in values]


def write(
    path: Path,
    names: Iterable[str] = SCENARIOS,
    draws: Mapping[str, int] | None = None,
    *,
    store: Path | None = None,
    jobs: int = -1,
) -> None:
    """Compute what is known of scenarios, and of so many drawn ones, and write it, whole or not at all."""
    found = {name: drawn(name, number, store=store, jobs=jobs) for name, number in (draws or {}).items()}
    rows = [row(name) for name in names]
    head = {"schema": SCHEMA, "command": COMMAND, "versions": versions()}
    write_json(path, head | {"references": rows, "draws": found})


def _published(section: str, name: str) -> dict[str, Any]:
    rows = published("solvers.json")["sections"][section]["rows"]
    found: dict[str, Any] = next(row for row in rows if row["scenario"] == name)
    return found


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "flatgym" / "scenarios" / FILE, help="file to write")
    parser.add_argument("--store", type=Path, default=RESULTS / "draws", help="folder of what is finished")
    parser.add_argument("--jobs", type=int, default=-1, help="worker processes; -1 is one a core")
    options = parser.parse_args()
    write(options.out, draws=DRAWS, store=options.store, jobs=options.jobs)


if __name__ == "__main__":
    main()
