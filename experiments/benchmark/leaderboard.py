"""The numbers of the report: one line for each problem and agent, how it stands disturbed, and how it learnt.

Whatever the page shows comes from here and stands in its data block, so that page and results can be compared.
No list of problems or agents is known beforehand: what the results hold is shown, what failed included.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from math import nan
from typing import Any

import numpy as np
import pandas as pd

from agents.evaluation.bootstrap import iqm
from experiments.benchmark.agents import called, place
from experiments.benchmark.conditions import CALM
from experiments.benchmark.summary import Scores, approach, pairs, runs_of, scored
from experiments.files import Row
from flatgym import SCENARIOS


@dataclass(frozen=True)
class LeaderboardRow:
    """An agent's undisturbed flights of a problem; NaN where there is nothing to say.

    Attributes:
        problem, agent: their names in the results.
        name: what the agent is called.
        runs, flights: how many trainings flew, and how often they did altogether.
        success, success_low, success_high: rate with its 95 % bootstrap interval.
        gap, gap_low, gap_high: interquartile mean of K / K* - 1 over successes, with its interval.
        steps, k_star: interquartile means of the environment steps and of K*.
        env_steps, expert_steps, learning_s: means over runs: steps flown and shown in learning, and its time [s].
        errors: what runs failed of, one sentence each.
    """

    problem: str
    agent: str
    name: str
    runs: int = 0
    flights: int = 0
    success: float = nan
    success_low: float = nan
    success_high: float = nan
    gap: float = nan
    gap_low: float = nan
    gap_high: float = nan
    steps: float = nan
    k_star: float = nan
    env_steps: float = nan
    expert_steps: float = nan
    learning_s: float = nan
    errors: tuple[str, ...] = ()

    @property
    def failed(self) -> bool:
        """Whether no run of it ever flew."""
        return not self.flights


@dataclass(frozen=True)
class ConditionScore:
    """An agent's flights of a problem under one condition; fields as those of a Line."""

    problem: str
    agent: str
    name: str
    condition: str
    success: float
    success_low: float
    success_high: float
    gap: float
    gap_low: float
    gap_high: float


@dataclass(frozen=True)
class Curve:
    """A training: the least gap to K* of its reliable checks, after so many steps, flown and shown together."""

    problem: str
    agent: str
    name: str
    seed: int
    steps: tuple[float, ...]
    gaps: tuple[float, ...]


@dataclass(frozen=True)
class Leaderboard:
    """All there is to say of the agents."""

    lines: tuple[LeaderboardRow, ...]
    standings: tuple[ConditionScore, ...]
    curves: tuple[Curve, ...]

    @property
    def problems(self) -> tuple[str, ...]:
        """The problems, in the order of their lines."""
        return tuple(dict.fromkeys(line.problem for line in self.lines))


def board(results: Row) -> Leaderboard:
    """Return the numbers of a benchmark's results, in the format of learners.json."""
    sound = results | {"cells": [cell for cell in results["cells"] if cell["flights"]]}
    found = scored(sound) if sound["cells"] else {}
    known = [(cell["problem"], cell["agent"]) for cell in results["cells"]]
    order = sorted(dict.fromkeys([*pairs(found), *known]), key=lambda pair: (*rank(pair[0]), place(pair[1])))
    return Leaderboard(
        tuple(line(results, sound, found, *pair) for pair in order),
        tuple(standings(sound, found, order)),
        tuple(curves(sound, order)),
    )


def rank(problem: str) -> tuple[int, str]:
    """Return a problem's place: named scenarios as the catalogue lists them, then others by name."""
    return (list(SCENARIOS).index(problem) if problem in SCENARIOS else len(SCENARIOS), problem)


def line(results: Row, sound: Row, found: Scores, problem: str, agent: str) -> LeaderboardRow:
    """Return the line of an agent: what its sound runs flew, and the errors of the others."""
    cells = runs_of(sound, problem, agent)
    errors = tuple(f"seed {cell['seed']}: {error(cell)}" for cell in runs_of(results, problem, agent) if error(cell))
    row = found.get((problem, agent, CALM))
    if row is None:
        return LeaderboardRow(problem, agent, called(agent), errors=errors)
    flown = max(len(cell["flights"][CALM]["steps"]) for cell in cells if CALM in cell["flights"])
    return LeaderboardRow(
        problem,
        agent,
        called(agent),
        runs=row["runs"],
        flights=row["flights"],
        **rates(row),
        steps=row["steps"],
        k_star=float(iqm(np.array(results["k_star"][problem], dtype=np.float64)[:flown])),
        env_steps=mean(cells, "env_steps"),
        expert_steps=mean(cells, "expert_steps"),
        learning_s=mean(cells, "wall_time_s"),
        errors=errors,
    )


def rates(row: Row) -> dict[str, Any]:
    """Return success and gap of a summary, with their intervals, as lines and standings name them."""
    bounds = ("success_low", "success_high", "gap", "gap_low", "gap_high")
    return {"success": row["success_rate"]} | {key: row[key] for key in bounds}


def mean(cells: Sequence[Row], key: str) -> float:
    """Return the mean of a number over runs."""
    return float(np.mean([cell[key] for cell in cells]))


def error(cell: Row) -> str:
    """Return what a run failed of, in one line; nothing where it did not."""
    words = cell.get("error") or ("" if cell["flights"] else "no flights, and no reason given")
    return " ".join(str(words).split())


def standings(sound: Row, found: Scores, order: Sequence[tuple[str, str]]) -> Iterator[ConditionScore]:
    """Yield how each agent stands under each condition in which it flew."""
    for problem, agent in order:
        for condition in sound["conditions"]:
            row = found.get((problem, agent, condition))
            if row is not None:
                yield ConditionScore(problem, agent, called(agent), condition, **rates(row))


def curves(sound: Row, order: Sequence[tuple[str, str]]) -> Iterator[Curve]:
    """Yield the trainings that were checked."""
    for problem, agent in order:
        for cell in runs_of(sound, problem, agent):
            if cell.get("curve"):
                steps, gaps = approach(cell, sound["k_check"][problem])
                yield Curve(problem, agent, called(agent), cell["seed"], tuple(steps), tuple(gaps))


COLUMNS = (
    "problem", "agent", "seeds", "condition", "success_rate", "success_low", "success_high", "gap", "gap_low",
    "gap_high", "env_steps", "learning_s", "error",
)  # fmt: skip
"""Columns of the table of scores."""


def scores(results: Row) -> pd.DataFrame:
    """Return one row for each problem, agent and condition: success and gap, their intervals, cost; and each error."""
    found = board(results)
    lines = {(line.problem, line.agent): line for line in found.lines}
    rows: list[Row] = []
    for one in found.standings:
        line = lines[one.problem, one.agent]
        rates = {"success_rate" if key == "success" else key: value for key, value in asdict(one).items()}
        rows.append(
            rates | {"seeds": line.runs, "env_steps": line.env_steps, "learning_s": line.learning_s, "error": ""}
        )
    for line in found.lines:
        shared = {"problem": line.problem, "agent": line.agent, "condition": "calm"}
        rows += [shared | {"error": words} for words in line.errors]
    return pd.DataFrame(rows, columns=list(COLUMNS))
