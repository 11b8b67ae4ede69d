"""The study of the learners: PPO, SAC, BC, DAgger and BC->PPO beside the expert, its tape and a PD controller.

    python -m experiments.learners
    python -m experiments.learners --only hoop/ppo random-goal/bc --seeds 1
    python -m experiments.learners --quick

A cell is a problem, an agent and a seed: one file, written whole when it is done. What is done is not done again, so
that a killed study goes on where it was. Every policy flies undisturbed and under each disturbance, all of them on the
same draws, which no training saw. All cells are joined into one file, from which `experiments.learner_table` reads.
"""

from __future__ import annotations

import argparse
import json
import platform
import shutil
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm

from agents import policies
from agents.evaluate import CALM, FasterThanOptimal, Policy, flight_rows, versions
from agents.optima import optima
from experiments.cli import progress_bar
from experiments.files import SCHEMA, plain, write_json
from experiments.recipes import EXPERTS, FULL, LEARNERS, ONLY_SCENARIOS, QUICK, Lesson, Made, Sizes, prepare
from flatgym.disturbances import Disturbances
from flatgym.reference import EVALUATION_SEED
from optimal.export import write_text

PROBLEMS = ("hoop", "random-goal")
CONDITIONS = {
    "calm": CALM,
    "wind": Disturbances(wind=0.5),
    "mass": Disturbances(mass=0.05),
    "delay": Disturbances(action_delay=1),
    "together": Disturbances(wind=0.25, mass=0.025, action_delay=1),
}
"""What stands against the vehicle: nothing, one disturbance, or wind and mass at half strength with the delay."""
SEEDS = 3
FIRST = ("bc", "bc-ppo")
"""The second begins with what the first gives."""
RESULTS = Path("experiments/results")


@dataclass(frozen=True)
class Cell:
    """One file of the study."""

    problem: str
    agent: str
    seed: int

    def path(self, folder: Path) -> Path:
        """Return its file."""
        return folder / f"{self.problem}-{self.agent}-{self.seed}.json"


def cells(seeds: int, only: Sequence[str] = ()) -> list[Cell]:
    """Return the cells of a study, in the order of its tables.

    Args:
        seeds: of each learner.
        only: "problem" or "problem/agent", those asked for; nothing for all. What one begins with comes with it.
    """
    found = [
        Cell(problem, agent, seed)
        for problem in PROBLEMS
        for agent in (*LEARNERS, *EXPERTS)
        for seed in range(seeds if agent in LEARNERS else 1)
        if not (agent in ONLY_SCENARIOS and problem.startswith("random-"))
    ]
    names = {name for cell in found for name in (cell.problem, f"{cell.problem}/{cell.agent}")}
    if unknown := sorted(set(only) - names):
        raise ValueError(f"unknown cells {', '.join(unknown)}; known: {', '.join(sorted(names))}")
    first, then = FIRST
    wanted = set(only) | {name.replace(then, first) for name in only if name.endswith(then)}
    return [cell for cell in found if not only or {cell.problem, f"{cell.problem}/{cell.agent}"} & wanted]


def run(cell: Cell, folder: Path, sizes: Sizes) -> str:
    """Make an agent, let it fly, and write its cell; return what went wrong, or nothing."""
    lesson = Lesson(cell.problem, cell.seed, folder, sizes)
    try:
        made = (LEARNERS | EXPERTS)[cell.agent](lesson)
        if isinstance(made.policy, BaseAlgorithm):
            policies.save(made.policy, lesson.file(cell.agent, ".zip"), cell.problem)
        words = told(cell, made) | {"flights": flown(made.policy, lesson, cell.agent)}
    except FasterThanOptimal as error:
        evidence = {"scenario": error.scenario.to_dict(), "k_star": error.k_star, "actions": error.actions}
        write_json(lesson.file(cell.agent, ".faster.json"), evidence)
        return f"{cell.problem}/{cell.agent}/{cell.seed}: {error}"
    except Exception as error:  # one cell must not end the others
        return f"{cell.problem}/{cell.agent}/{cell.seed}: {type(error).__name__}: {error}"
    write_text(cell.path(folder), json.dumps(plain(words)) + "\n")
    shutil.rmtree(lesson.file(cell.agent, ""), ignore_errors=True)
    return ""


def told(cell: Cell, made: Made) -> dict[str, Any]:
    """Return what is to be known of an agent besides its flights."""
    return {
        "schema": SCHEMA,
        **asdict(cell),
        "algorithm": made.algorithm,
        "configs": [{"kind": type(config).__name__} | asdict(config) for config in made.configs],
        "command": f"python -m experiments.learners --only {cell.problem}/{cell.agent} --seeds {cell.seed + 1}",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "env_steps": made.env_steps,
        "expert_steps": made.expert_steps,
        "wall_time_s": round(made.wall_time_s, 1),
        "planning_s": round(made.planning_s, 2),
        "curve": list(made.curve),
    }


def flown(policy: Policy, lesson: Lesson, agent: str) -> dict[str, Any]:
    """Let a policy fly under all conditions; return the outcomes and each flight's steps, None where it failed."""
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
    return found


def flights_of(lesson: Lesson, agent: str, calm: bool) -> int:
    """Return how many flights an agent flies: one tells all of a deterministic policy on an undisturbed scenario."""
    sizes = lesson.sizes
    if calm and not lesson.drawn:
        return 1
    if agent == "replanner":
        return sizes.replanned
    return sizes.goals if calm and agent not in ("expert", "tape") else sizes.disturbed


def joined(folder: Path, done: Iterable[Cell], k_check: dict[str, float], quick: bool, command: str) -> dict[str, Any]:
    """Return all cells and what they share: K* of the flights scored, and of those that learning curves are made of.

    Raises:
        ValueError: for a cell of another version of this file, naming it.
    """
    found = []
    for cell in done:
        found.append(json.loads(cell.path(folder).read_text(encoding="utf-8")))
        if found[-1]["schema"] != SCHEMA:
            raise ValueError(f"{cell.path(folder)} has schema {found[-1]['schema']}, wanted {SCHEMA}: delete it")
    problems = dict.fromkeys(cell["problem"] for cell in found)
    most = {name: max(len(f["steps"]) for c in found if c["problem"] == name for f in c["flights"].values())
            for name in problems}  # fmt: skip
    return {
        "schema": SCHEMA,
        "quick": quick,
        "command": command,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "machine": {"processor": platform.machine(), "system": platform.system(), "cores": joblib.cpu_count()},
        "conditions": {name: disturbances.active for name, disturbances in CONDITIONS.items()},
        "k_check": {name: k_check[name] for name in problems},
        "k_star": {name: optima(name, EVALUATION_SEED + np.arange(most[name])).k_star for name in problems},
        "cells": found,
    }


def write(path: Path, results: dict[str, Any]) -> None:
    """Write the results, a line for each value and each cell."""
    lines = [f" {json.dumps(key)}: {json.dumps(plain(value))}" for key, value in results.items() if key != "cells"]
    rows = ",\n".join(f"  {json.dumps(plain(cell))}" for cell in results["cells"])
    write_text(path, "{\n" + ",\n".join([*lines, f' "cells": [\n{rows}\n ]']) + "\n}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is not done yet, and join all that is; 1 where something went wrong."""
    parser = argparse.ArgumentParser(prog="python -m experiments.learners", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", nargs="+", default=[], metavar="PROBLEM[/AGENT]", help="those cells")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="trainings of each learner")
    parser.add_argument("--jobs", type=int, default=2, help="cells at a time")
    parser.add_argument("--quick", action="store_true", help="small sizes, to see that everything runs")
    parser.add_argument("--out", type=Path, help="the JSON to write; the cells are kept in a folder of its name")
    given = parser.parse_args(arguments)
    command = " ".join(["python -m experiments.learners", *(sys.argv[1:] if arguments is None else arguments)])
    out = given.out or RESULTS / f"learners{'-quick' if given.quick else ''}.json"
    folder, sizes = out.with_suffix(""), QUICK if given.quick else FULL
    try:
        wanted = cells(given.seeds, given.only)
    except ValueError as error:
        parser.error(str(error))
    everything = cells(max(given.seeds, SEEDS))
    known = [cell for cell in everything if cell.path(folder).exists()]
    failures, k_check = [], {}
    with progress_bar() as bar:
        problems = dict.fromkeys(cell.problem for cell in (*wanted, *known))
        planning = bar.add_task("planning", total=len(problems), note="")
        for problem in problems:
            k_check[problem] = prepare(Lesson(problem, 0, folder, sizes))
            bar.advance(planning)
        left = [cell for cell in wanted if cell not in known]
        work = bar.add_task("cells", total=len(left), note="")
        for wave in ([c for c in left if c.agent != FIRST[1]], [c for c in left if c.agent == FIRST[1]]):
            calls = [joblib.delayed(run)(cell, folder, sizes) for cell in wave]
            for failure in joblib.Parallel(n_jobs=given.jobs, return_as="generator_unordered")(calls):
                failures += [failure] if failure else []
                bar.update(work, note=f"{len(failures)} failed" if failures else "")
                bar.advance(work)
    done = [cell for cell in everything if cell.path(folder).exists()]
    if done:
        write(out, joined(folder, done, k_check, given.quick, command))
    print("\n".join([*failures, f"{len(done)} of {len(everything)} cells written to {out}"]))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
