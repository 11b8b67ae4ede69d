"""The table `flatgym/scenarios/reference.json`: the best-known solutions of the named scenarios, and sampled K*.

K* and its flight are recomputed. T* and the bounds, which take minutes, are those published in `solvers.json`. A K*
that differs from the published one is refused, because one of the two is out of date. For the scenarios of the
distributions that scores use, K* is computed and proven here. Finished scenarios are stored, so an interrupted run
resumes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import optimal
from experiments.files import published, write_json
from experiments.provenance import provenance
from flatgym import DISTRIBUTIONS, SCENARIOS
from flatgym.scenarios.reference import EVALUATION_SEED, SCHEMA

SAMPLED = {"random-goal": 1000, "random-hoops": 300, "random-track": 100}
"""Number of scenarios of each distribution in the table."""
PROOF_TIME = 60.0
"""Time budget for the proof of each K* [s]. A scenario of random-goal takes about 0.3 s, of random-hoops about 6 s, and
some need more than 10 s."""


def named_row(name: str) -> dict[str, Any]:
    """Return the best-known solution of a named scenario, with actions that float32 reads back exactly.

    Raises:
        ValueError: if the computed K* differs from that in `solvers.json`.
    """
    steps, bounds = (_published(section, name) for section in ("steps", "bounds"))
    found = optimal.fewest_steps(name, time_budget=0)
    if found.steps != steps["k_star"]:
        raise ValueError(
            f"{name}: a flight in {found.steps:g} steps was found, but solvers.json has K* = {steps['k_star']}; run "
            "`flatquad measure solvers steps`, then `flatquad publish`"
        )
    return {
        "scenario": name,
        "k_star": steps["k_star"],
        "k_lower_bound": steps["lower_bound"],
        "proven": steps["proven"],
        "time_s": bounds["upper_bound_s"],
        "time_lower_bound_s": bounds["lower_bound_s"],
        "winding": found.winding,
        "actions": shortest_decimals(found.actions),
    }


def sampled_k_star(name: str, number: int, *, store: Path | None = None, jobs: int = -1) -> dict[str, Any]:
    """Return K* of the first scenarios of a distribution, with seeds from EVALUATION_SEED on.

    Raises:
        ValueError: if no flight was found; it names the scenario.
    """
    scenarios = [DISTRIBUTIONS[name].scenario(EVALUATION_SEED + i) for i in range(number)]
    answers = optimal.fewest_steps_many(scenarios, time_budget=PROOF_TIME, store=store, jobs=jobs)
    for answer in answers:
        if not math.isfinite(answer.steps):
            raise ValueError(f"{answer.scenario.name}: no flight was found: {answer.reason}")
    return {
        "first_seed": EVALUATION_SEED,
        "k_star": [int(answer.steps) for answer in answers],
        "k_lower_bound": [answer.lower_bound for answer in answers],
    }


def shortest_decimals(values: NDArray[np.float32]) -> list[list[float]]:
    """Return float32 numbers with the fewest digits that read back the same, shape (n, m)."""
    return [[float(str(value)) for value in row] for row in values]


def write_table(
    path: Path,
    names: Iterable[str] = SCENARIOS,
    sampled: Mapping[str, int] | None = None,
    *,
    command: str = "flatquad measure reference",
    store: Path | None = None,
    jobs: int = -1,
) -> None:
    """Compute the table and write it, whole or not at all.

    Args:
        path: the file to write.
        names: the named scenarios in it.
        sampled: number of sampled scenarios by distribution; none by default.
        command: the command line, for the record.
        store: folder of the finished sampled scenarios.
        jobs: worker processes; -1 uses all cores.
    """
    draws = {name: sampled_k_star(name, number, store=store, jobs=jobs) for name, number in (sampled or {}).items()}
    rows = [named_row(name) for name in names]
    write_json(path, provenance(command) | {"schema": SCHEMA, "references": rows, "draws": draws})


def _published(section: str, name: str) -> dict[str, Any]:
    rows = published("solvers.json")["sections"][section]["rows"]
    found: dict[str, Any] = next(row for row in rows if row["scenario"] == name)
    return found
