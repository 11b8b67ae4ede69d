"""Statistics over the cells of a benchmark: scores with intervals, learning curves, sample counts."""

from __future__ import annotations

from itertools import accumulate

import numpy as np
import pandas as pd

from agents.evaluation.bootstrap import summary
from experiments.benchmark.agents import table_position
from experiments.files import Row

Scores = dict[tuple[str, str, str], Row]
"""Score rows by problem, agent and condition."""
TARGET_SUCCESS, TARGET_GAP = 0.9, 0.1
"""Success rate and mean gap of the validation that ends the sample count of a training."""


def episode_table(results: Row) -> pd.DataFrame:
    """Return one row for each episode: scenario, agent, run, condition, outcome, steps, gap; NaN where it failed."""
    parts = []
    for cell in results["cells"]:
        for condition, episodes in cell["episodes"].items():
            steps = np.array(episodes["steps"], dtype=np.float64)
            k_star = np.array(results["k_star"][cell["problem"]], dtype=np.float64)[: len(steps)]
            shared = {"scenario": cell["problem"], "agent": cell["agent"], "run": cell["seed"], "condition": condition}
            outcome = np.where(np.isnan(steps), "failed", "goal")
            parts.append(pd.DataFrame(shared | {"outcome": outcome, "steps": steps, "gap": steps / k_star - 1}))
    return pd.concat(parts, ignore_index=True)


def summarise(results: Row) -> Scores:
    """Return the scores of each problem, agent and condition, with bootstrap intervals, in the order of the tables."""
    table = summary(episode_table(results), ("scenario", "agent", "condition")).to_dict("records")
    table.sort(key=lambda row: table_position(row["agent"]))
    return {(row["scenario"], row["agent"], row["condition"]): row for row in table}


def pairs(scores: Scores) -> list[tuple[str, str]]:
    """Return all pairs of problem and agent, sorted by problem, then in the order of the tables."""
    problems = sorted({problem for problem, _, _ in scores})
    known = dict.fromkeys((problem, agent) for problem, agent, _ in scores)
    return [pair for problem in problems for pair in known if pair[0] == problem]


def cells_of(results: Row, problem: str, agent: str) -> list[Row]:
    """Return the cells of an agent on a problem."""
    return [cell for cell in results["cells"] if (cell["problem"], cell["agent"]) == (problem, agent)]


def samples_to_target(cell: Row, validation_k_star: float) -> float:
    """Return the samples (env steps + expert labels) until validation reaches both targets; NaN if it never does."""
    for point in cell["curve"]:
        if point["success_rate"] >= TARGET_SUCCESS and point["steps"] / validation_k_star - 1 <= TARGET_GAP:
            return float(point["env_steps"] + point["expert_labels"])
    return float("nan")


def learning_curve(cell: Row, validation_k_star: float) -> tuple[list[float], list[float]]:
    """Return the samples at each validation of target success, and the smallest gap up to then."""
    good = [point for point in cell["curve"] if point["success_rate"] >= TARGET_SUCCESS]
    samples = [float(point["env_steps"] + point["expert_labels"]) for point in good]
    gaps = [float(point["steps"] / validation_k_star - 1) for point in good]
    return samples, list(accumulate(gaps, min))
