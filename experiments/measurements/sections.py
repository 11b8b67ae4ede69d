"""Measurements: sections that are run and joined in one results file, and what the sections share.

A section is a function that answers one question in plain rows. The results file of a measurement holds its sections
with the machine and the versions. Each section states its command, date, commit and wall time, because sections can be
run one at a time.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from rich.progress import Progress, TaskID

from experiments.files import Row, move_aside, write_json
from experiments.provenance import now, provenance
from flatgym import Scenario
from flatgym.validation import choice
from optimal.parallel import parallel_results

Advance = Callable[[int, int], None]
"""Progress callback: the number of finished parts, and of all parts."""
Section = Callable[[bool, Advance], list[Row]]
"""Returns the rows of a section; called with whether small sizes are enough, and with a progress callback."""

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
PROCESSES = 2
"""Worker processes of sections that run in parallel."""
HALF_WIDTH = 10.0
"""Half the width of the square of uniform goals [m]."""
LEAST_DISTANCE = 0.5
"""Least distance of a uniform goal from the start [m]."""


def uniform_goal(generator: np.random.Generator, number: int) -> Scenario:
    """Return a scenario whose goal is uniform in the square around the start, at least LEAST_DISTANCE away.

    These goals come from a NumPy generator. They are other scenarios than those of the distribution `random-goal`,
    which has its own seeds.
    """
    while True:
        goal = generator.uniform(-HALF_WIDTH, HALF_WIDTH, 2)
        if np.hypot(*goal) >= LEAST_DISTANCE:
            return Scenario(f"goal-{number}", (0.0, 0.0), (float(goal[0]), float(goal[1])))


def convergence_order(nodes: Sequence[int], errors: Any) -> float:
    """Return the slope of -log |error| over log nodes by least squares."""
    return float(-np.polyfit(np.log(nodes), np.log(np.abs(errors)), 1)[0])


def median(times: Sequence[float]) -> Row:
    """Return median, minimum and number of wall times [s]."""
    return {"median_s": statistics.median(times), "least_s": min(times), "runs": len(times)}


def fresh_process(code: str) -> float:
    """Return the wall time of a new Python process that runs `code` [s]."""
    begun = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True, start_new_session=True)  # Ctrl-C is for this process
    return time.perf_counter() - begun


def in_parallel(function: Callable[..., Row], tasks: Iterable[Sequence[Any]], advance: Advance) -> list[Row]:
    """Return `function(*task)` of all tasks, in their order."""
    calls = [joblib.delayed(function)(*task) for task in tasks]
    rows: list[Row] = []
    for row in parallel_results(calls, PROCESSES):
        rows.append(row)
        advance(len(rows), len(calls))
    return rows


def measure(sections: Mapping[str, Section], out: Path, *, smoke: bool, command: str, bar: Progress) -> Row:
    """Run sections and write each when it ends into a results file, beside its other sections of the same kind.

    Args:
        sections: by name.
        out: the results file.
        smoke: use small sizes, to see that everything runs.
        command: the command line, for the record.
        bar: shows the progress.

    Returns:
        The content of the results file.

    Raises:
        ValueError: if there is a file of another kind at that path, before anything is run.
    """
    check_kind(out)
    results: Row = {}
    for name, section in sections.items():
        results = join(out, run({name: section}, smoke=smoke, command=command, bar=bar))
        write_json(out, results)
    return results


def check_kind(path: Path) -> None:
    """Raise a ValueError for an existing file that no measurement has written; it stays as it is."""
    if not path.exists():
        return
    try:
        known = "sections" in json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, TypeError):
        known = False
    if not known:
        raise ValueError(f"{path} exists and is not a results file of `flatquad measure`; name another --out")


def run(sections: Mapping[str, Section], *, smoke: bool, command: str, bar: Progress) -> Row:
    """Run sections and return their rows with provenance; arguments as in `measure`."""
    results = provenance(command) | {"smoke": smoke, "sections": {}}
    source = {key: results[key] for key in SOURCE}
    for name, section in sections.items():
        task: TaskID = bar.add_task(name, total=None, note="")
        begun = time.perf_counter()
        rows = section(smoke, lambda done, of, task=task: bar.update(task, completed=done, total=of))  # type: ignore[misc]
        spent = {"date": now(), "wall_time_s": time.perf_counter() - begun}
        results["sections"][name] = {"rows": rows, "command": command} | source | spent
    return results


SAME = ("schema", "smoke")
"""Entries in which two results files agree if their sections may stand in one file."""
SOURCE = ("versions", "machine", "processor", "commit")
"""Entries that each section has of its own."""


def join(path: Path, results: Row) -> Row:
    """Return results with the other sections of a results file, if it is of the same kind; else move it aside."""
    if not path.exists():
        return results
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
        alike = all(before[key] == results[key] for key in SAME)
    except (ValueError, TypeError, KeyError):
        alike = False
    if not alike:
        aside = move_aside(path)
        reason = "is damaged, or of another schema or size"
        print(f"{path} {reason}; moved aside to {aside.name}", file=sys.stderr)
        return results
    source = {key: before[key] for key in SOURCE if key in before}
    # Sections of older files have no machine of their own; the entries of the file are theirs.
    sections = before["sections"].items()
    earlier = {name: section if "machine" in section else source | section for name, section in sections}
    return results | {"sections": earlier | results["sections"]}


def chosen(sections: Mapping[str, Section], names: Sequence[str]) -> dict[str, Section]:
    """Return the sections of these names, or all if there are none.

    Raises:
        ValueError: for an unknown name; it lists the known ones.
    """
    return {choice("section", name, sections): sections[name] for name in names or sections}
