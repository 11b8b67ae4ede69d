"""What single trainings by reward gave: a record of their folders, for the table of what was tried.

    python -m experiments.benchmark.trainings runs/ppo-hoop-0 runs/sac-hoop-0 --beside-other-work

A folder of `flatquad train` holds the configuration and the learning curve. The record is appended to `trainings.json`;
an earlier one of the same configuration is replaced.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from agents.evaluation.validation import best_of, validation_scenarios
from agents.training.configs import Config, from_json
from experiments.files import REPOSITORY_RESULTS, Row, cache_folder, published, read_json, write_json
from experiments.provenance import processor, provenance
from flatgym import SCENARIOS, reference
from flatgym.scenarios import catalogue
from optimal.batch import fewest_steps_many

FILE = "trainings.json"
NOT_CHANGES = ("scenario", "seed", "folder", "max_seconds", "tensorboard", "eval_every")
"""Fields of a configuration that are no part of a recipe."""


def training_record(folder: Path, beside_other_work: bool = False) -> Row:
    """Return what a training gave: problem, algorithm, changed fields, seed, and the best validation.

    Args:
        folder: of the training.
        beside_other_work: whether other processes slowed it, so that its wall time says nothing.
    """
    config = from_json((folder / "config.json").read_text(encoding="utf-8"))
    lines = (folder / "curve.jsonl").read_text(encoding="utf-8").splitlines()
    curve = [json.loads(line) for line in lines]
    best = best_of(curve)
    return {
        "problem": catalogue.label(config.scenario),
        "algorithm": config.algorithm,
        "changed": changed(config),
        "seed": config.seed,
        "success_rate": best["success_rate"] if best else 0.0,
        "steps": best["steps"] if best else None,
        "k_star": validation_k_star(config),
        "best_at": best["env_steps"] if best else None,
        "env_steps": curve[-1]["env_steps"],
        "wall_time_s": curve[-1]["wall_time_s"],
        "beside_other_work": beside_other_work,
        "processor": processor(),
    }


def changed(config: Config) -> Row:
    """Return the fields of a configuration that differ from their defaults and belong to the recipe."""
    defaults = asdict(type(config)())
    return {
        name: value for name, value in asdict(config).items() if value != defaults[name] and name not in NOT_CHANGES
    }


def validation_k_star(config: Config) -> float:
    """Return K* of a scenario, or its mean over the validation episodes of a distribution."""
    scenarios = validation_scenarios(config.scenario, config.n_eval_episodes)
    if len(scenarios) == 1 and (known := reference(scenarios[0])):
        return float(known.k_star)
    flights = fewest_steps_many(scenarios, jobs=1, store=cache_folder() / "validation", progress=False)
    return float(np.mean([flight.steps for flight in flights]))


def add_records(results: Row | None, records: Sequence[Row], command: str) -> Row:
    """Return results with further records, in the order of the catalogue; one of the same recipe is replaced."""
    known = {recipe(record): record for record in (results or {}).get("trainings", [])}
    known |= {recipe(record): record for record in records}
    rows = sorted(known.values(), key=lambda row: (position(row["problem"]), row["problem"], row["algorithm"]))
    return provenance(command) | {"trainings": rows}


def position(problem: str) -> int:
    """Return the position of a task in the tables: that in the catalogue, all others last."""
    names = list(SCENARIOS)
    return names.index(problem) if problem in names else len(names)


def recipe(record: Row) -> tuple[str, ...]:
    """Return what two records of the same training have in common."""
    return record["problem"], record["algorithm"], json.dumps(record["changed"]), str(record["seed"])


def main(arguments: Sequence[str] | None = None, out: Path = REPOSITORY_RESULTS / FILE) -> None:
    """Record the trainings in folders."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, help="folders of trainings")
    parser.add_argument("--beside-other-work", action="store_true", help="other processes slowed them")
    given = parser.parse_args(arguments)
    records = [training_record(folder, given.beside_other_work) for folder in given.folders]
    write_json(out, add_records(read_json(out) or _published(), records, "flatquad train, one for each row"))


def _published() -> Row | None:
    try:
        return published(FILE)
    except (OSError, ValueError):
        return None


if __name__ == "__main__":
    main()
