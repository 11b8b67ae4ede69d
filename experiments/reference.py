"""Write `flatgym/reference.json`, what is known of the named scenarios: `python -m experiments.reference`.

K* and its flight are searched anew; T* and the bounds, which take minutes, are those published in `solvers.json`.
A K* that differs from the published one is refused: one of the two is out of date.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import optimal
from agents.evaluate import versions
from experiments.files import write_json
from experiments.readme import ROOT, published
from flatgym import SCENARIOS
from flatgym.reference import FILE, SCHEMA

COMMAND = "python -m experiments.reference"


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
            f"python -m experiments.solver_benchmark --section steps, and publish it"
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


def shortest(values: NDArray[np.float32]) -> list[list[float]]:
    """Return float32 numbers with the fewest digits that read back the same, shape (n, m)."""
    return [[float(str(value)) for value in line] for line in values]


def write(path: Path, names: Iterable[str] = SCENARIOS) -> None:
    """Compute the rows of scenarios and write them, whole or not at all."""
    rows = [row(name) for name in names]
    write_json(path, {"schema": SCHEMA, "command": COMMAND, "versions": versions(), "references": rows})


def _published(section: str, name: str) -> dict[str, Any]:
    rows = published("solvers.json")["sections"][section]["rows"]
    found: dict[str, Any] = next(row for row in rows if row["scenario"] == name)
    return found


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "flatgym" / FILE, help="file to write")
    write(parser.parse_args().out)


if __name__ == "__main__":
    main()
