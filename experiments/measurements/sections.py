"""What the benchmarks share: sections run and kept in one file, wall times, random goals, orders of convergence.

A benchmark is a table of sections. Each answers one question in plain rows; they make one JSON file with the versions
and the machine, and each says by which command, when, and in how much time it came about.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import Progress, TaskID

from agents.evaluation.versions import versions
from experiments.files import SCHEMA, Row, set_aside, write_json
from experiments.provenance import machine, now
from flatgym import Scenario

Advance = Callable[[int, int], None]
"""Called with what is done and what there is to do."""
Section = Callable[[bool, Advance], list[Row]]
"""Answers one question; called with whether small sizes are enough, and with what to tell of the progress."""

REFERENCE_TIMES = {
    "horizontal-3": 0.8987,
    "horizontal-6": 1.23132,
    "horizontal-9": 1.48822,
    "horizontal-12": 1.70490,
    "horizontal-15": 1.89584,
    "ground-6": 1.23408,
    "diagonal": 1.4112,
    "hoop": 1.41143,
    "climb": 1.30037,
}
"""T* [s] found by other code and finer grids before this project."""
REACH = 10.0
"""Half the width of the square of random goals [m]."""


def random_goal(generator: np.random.Generator, number: int) -> Scenario:
    """Draw a goal in the square around the start, at least half a metre away."""
    while True:
        goal = generator.uniform(-REACH, REACH, 2)
        if np.hypot(*goal) >= 0.5:
            return Scenario(f"goal-{number}", (0.0, 0.0), (float(goal[0]), float(goal[1])))


def convergence_order(nodes: Sequence[int], errors: Any) -> float:
    """Return the slope of -log |error| over log nodes by least squares."""
    return float(-np.polyfit(np.log(nodes), np.log(np.abs(errors)), 1)[0])


def median(taken: Sequence[float]) -> Row:
    """Return median, least and number of wall times [s]."""
    return {"median_s": statistics.median(taken), "least_s": min(taken), "runs": len(taken)}


def fresh_process(code: str) -> float:
    """Return the wall time of a new Python process that runs `code` [s]."""
    begun = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True)
    return time.perf_counter() - begun


def run(sections: Mapping[str, Section], *, quick: bool, command: str, bar: Progress) -> Row:
    """Run sections of a benchmark.

    Args:
        sections: by name.
        quick: small sizes, to see that everything runs.
        command: what the user typed, for the record.
        bar: shows how far the work is.

    Returns:
        What the results file holds.
    """
    results: Row = {
        "schema": SCHEMA,
        "quick": quick,
        "versions": versions(),
        "machine": machine(),
        "sections": {},
    }
    for name, section in sections.items():
        task: TaskID = bar.add_task(name, total=None)
        begun = time.perf_counter()
        rows = section(quick, lambda done, of, task=task: bar.update(task, completed=done, total=of))  # type: ignore[misc]
        results["sections"][name] = {
            "rows": rows,
            "command": command,
            "date": now(),
            "wall_time_s": time.perf_counter() - begun,
        }
    return results


def joined(path: Path, results: Row) -> Row:
    """Return results with the other sections of a file of the same kind, versions and machine, if there is one."""
    if not path.exists():
        return results
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
        alike = all(before[key] == results[key] for key in results if key != "sections")
    except (ValueError, TypeError, KeyError):
        alike = False
    if not alike:
        aside = set_aside(path)
        print(f"{path} is damaged, or of other versions, sizes or another machine; set aside as {aside.name}")
        return results
    return results | {"sections": before["sections"] | results["sections"]}


def main(
    module: str, purpose: str, sections: Mapping[str, Section], out: Path, arguments: Sequence[str] | None = None
) -> None:
    """Run a benchmark's script.

    Args:
        module: its name, as one runs it by `python -m`.
        purpose: its docstring; the first line is shown as help.
        sections: all there are, by name.
        out: the results file unless another is given.
        arguments: of the command line; by default the process's own.
    """
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=purpose.split("\n")[0])
    parser.add_argument("--out", type=Path, default=out, help="the JSON to write")
    parser.add_argument("--quick", action="store_true", help="small sizes, to see that everything runs")
    parser.add_argument("--section", nargs="+", choices=list(sections), default=list(sections), help="which to run")
    given = parser.parse_args(arguments)
    command = " ".join([f"python -m {module}", *(sys.argv[1:] if arguments is None else arguments)])
    with Progress() as bar:
        results = run({name: sections[name] for name in given.section}, quick=given.quick, command=command, bar=bar)
    write_json(given.out, joined(given.out, results))
    print(f"{', '.join(given.section)} written to {given.out}")
