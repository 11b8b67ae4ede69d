"""The leaderboard: for each problem and agent its scores, its training cost, and its learning curves.

    leaderboard = Leaderboard.of(results)

The report page and the table of scores show these numbers. Problems and agents are those of the results, failed ones
included; there is no list of them. The bootstrap intervals take seconds, so make it once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from math import nan
from typing import Any

import numpy as np
import pandas as pd

from agents.evaluation.bootstrap import iqm
from experiments.benchmark.agents import table_position
from experiments.benchmark.conditions import NOMINAL
from experiments.benchmark.shipped import shown_name
from experiments.benchmark.summary import Scores, cells_of, learning_curve, pairs, summarise
from experiments.files import Row
from flatgym import SCENARIOS


@dataclass(frozen=True)
class LeaderboardRow:
    """The nominal score of an agent on a problem; NaN for unknown values.

    Attributes:
        problem, agent: their names in the results.
        name: display name of the agent.
        runs, episodes: numbers of training runs, and of episodes of all runs.
        success, success_low, success_high: success rate with its 95 % bootstrap interval.
        gap, gap_low, gap_high: interquartile mean of K / K* - 1 over successes, with its interval.
        steps, k_star: interquartile means of the steps of an episode and of K*.
        env_steps, expert_labels, training_s: means over runs: environment steps and expert labels of the training, and
            training time [s].
        errors: of failed runs, one sentence each.
    """

    problem: str
    agent: str
    name: str
    runs: int = 0
    episodes: int = 0
    success: float = nan
    success_low: float = nan
    success_high: float = nan
    gap: float = nan
    gap_low: float = nan
    gap_high: float = nan
    steps: float = nan
    k_star: float = nan
    env_steps: float = nan
    expert_labels: float = nan
    training_s: float = nan
    errors: tuple[str, ...] = ()

    @property
    def failed(self) -> bool:
        """Whether all runs failed."""
        return not self.episodes


@dataclass(frozen=True)
class ConditionScore:
    """The score of an agent on a problem under one condition; fields as those of a LeaderboardRow."""

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
    """The learning curve of a run: smallest gap to K* so far over samples (env steps + expert labels)."""

    problem: str
    agent: str
    name: str
    seed: int
    samples: tuple[float, ...]
    gaps: tuple[float, ...]


@dataclass(frozen=True)
class Leaderboard:
    """Nominal rows, scores under all conditions, and learning curves."""

    rows: tuple[LeaderboardRow, ...]
    scores: tuple[ConditionScore, ...]
    curves: tuple[Curve, ...]

    @classmethod
    def of(cls, results: Row) -> Leaderboard:
        """Return the leaderboard of results, in the format of learners.json."""
        flown = results | {"cells": [cell for cell in results["cells"] if cell["episodes"]]}
        scores = summarise(flown) if flown["cells"] else {}
        known = [(cell["problem"], cell["agent"]) for cell in results["cells"]]
        order = sorted(
            dict.fromkeys([*pairs(scores), *known]), key=lambda pair: (*position(pair[0]), table_position(pair[1]))
        )
        return cls(
            tuple(nominal_row(results, flown, scores, *pair) for pair in order),
            tuple(condition_scores(flown, scores, order)),
            tuple(curves(flown, order)),
        )

    @property
    def problems(self) -> tuple[str, ...]:
        """The problems, in the order of the rows."""
        return tuple(dict.fromkeys(row.problem for row in self.rows))


def position(problem: str) -> tuple[int, str]:
    """Return the sort key of a problem: named scenarios in the order of the catalogue, then others by name."""
    return (list(SCENARIOS).index(problem) if problem in SCENARIOS else len(SCENARIOS), problem)


def nominal_row(results: Row, flown: Row, scores: Scores, problem: str, agent: str) -> LeaderboardRow:
    """Return the row of an agent: the scores of the runs that have flown, and the errors of the others."""
    cells = cells_of(flown, problem, agent)
    name = shown_name(agent, cells)
    errors = tuple(
        f"seed {cell['seed']}: {text}" for cell in cells_of(results, problem, agent) if (text := error_text(cell))
    )
    score = scores.get((problem, agent, NOMINAL))
    if score is None:
        return LeaderboardRow(problem, agent, name, errors=errors)
    count = max(len(cell["episodes"][NOMINAL]["steps"]) for cell in cells if NOMINAL in cell["episodes"])
    return LeaderboardRow(
        problem,
        agent,
        name,
        runs=score["runs"],
        episodes=score["episodes"],
        **rates(score),
        steps=score["steps"],
        k_star=float(iqm(np.array(results["k_star"][problem], dtype=np.float64)[:count])),
        env_steps=mean(cells, "env_steps"),
        expert_labels=mean(cells, "expert_labels"),
        training_s=mean(cells, "training_s"),
        errors=errors,
    )


def rates(score: Row) -> dict[str, Any]:
    """Return success and gap of a score, with their intervals, under the names of LeaderboardRow."""
    same = ("success_low", "success_high", "gap", "gap_low", "gap_high")
    return {"success": score["success_rate"]} | {key: score[key] for key in same}


def mean(cells: Sequence[Row], key: str) -> float:
    """Return the mean of a number over cells."""
    return float(np.mean([cell[key] for cell in cells]))


def error_text(cell: Row) -> str:
    """Return the error of a failed cell in one line; "" for the others."""
    text = cell.get("error") or ("" if cell["episodes"] else "no episodes, and no error given")
    return " ".join(str(text).split())


def condition_scores(flown: Row, scores: Scores, order: Sequence[tuple[str, str]]) -> Iterator[ConditionScore]:
    """Yield the score of each agent under each condition it has flown."""
    for problem, agent in order:
        name = shown_name(agent, cells_of(flown, problem, agent))
        for condition in flown["conditions"]:
            score = scores.get((problem, agent, condition))
            if score is not None:
                yield ConditionScore(problem, agent, name, condition, **rates(score))


def curves(flown: Row, order: Sequence[tuple[str, str]]) -> Iterator[Curve]:
    """Yield the learning curves of all runs with validation points."""
    for problem, agent in order:
        cells = cells_of(flown, problem, agent)
        for cell in cells:
            if cell.get("curve"):
                samples, gaps = learning_curve(cell, flown["validation_k_star"][problem])
                yield Curve(problem, agent, shown_name(agent, cells), cell["seed"], tuple(samples), tuple(gaps))


SCORE_COLUMNS = (
    "problem", "agent", "seeds", "condition", "success_rate", "success_low", "success_high", "gap", "gap_low",
    "gap_high", "env_steps", "training_s", "error",
)  # fmt: skip
"""Columns of the table of scores."""


def score_table(leaderboard: Leaderboard) -> pd.DataFrame:
    """Return one row for each problem, agent and condition, with SCORE_COLUMNS, and one for each error."""
    nominal = {(row.problem, row.agent): row for row in leaderboard.rows}
    table: list[Row] = []
    for score in leaderboard.scores:
        row = nominal[score.problem, score.agent]
        rates = {"success_rate" if key == "success" else key: value for key, value in asdict(score).items()}
        cost = {"seeds": row.runs, "env_steps": row.env_steps, "training_s": row.training_s}
        table.append(rates | cost | {"error": ""})
    for row in leaderboard.rows:
        shared = {"problem": row.problem, "agent": row.agent, "condition": NOMINAL}
        table += [shared | {"error": text} for text in row.errors]
    return pd.DataFrame(table, columns=list(SCORE_COLUMNS))
