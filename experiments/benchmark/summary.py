"""TODO experiments/benchmark/summary.py."""

from __future__ import annotations

from itertools import accumulate

import numpy as np
import pandas as pd

from agents.evaluation.bootstrap import summary
from experiments.benchmark.agents import place
from experiments.files import Row

Scores = dict[tuple[str, str, str], Row]
"""What flights add up to, by scenario, agent and condition."""
RELIABLE, NEAR = 0.9, 0.1
"""Success and mean gap of a check from which an agent counts as having learnt."""


def flights(results: Row) -> pd.DataFrame:
    """Return one row a flight: scenario, agent, run, condition, outcome, steps, gap; steps and gap NaN where failed."""
    parts = []
    for cell in results["cells"]:
        for condition, flown in cell["flights"].items():
            steps = np.array(flown["steps"], dtype=np.float64)
            k_star = np.array(results["k_star"][cell["problem"]], dtype=np.float64)[: len(steps)]
            shared = {"scenario": cell["problem"], "agent": cell["agent"], "run": cell["seed"], "condition": condition}
            outcome = np.where(np.isnan(steps), "failed", "goal")
            parts.append(pd.DataFrame(shared | {"outcome": outcome, "steps": steps, "gap": steps / k_star - 1}))
    return pd.concat(parts, ignore_index=True)


def scored(results: Row) -> Scores:
    """Return the summary of each scenario, agent and condition, in the order of NAMES."""
    table = summary(flights(results), ("scenario", "agent", "condition")).to_dict("records")
    table.sort(key=lambda row: place(row["agent"]))
    return {(row["scenario"], row["agent"], row["condition"]): row for row in table}


def learnt_after(cell: Row, k_check: float) -> float:
    """Return the environment steps, flown and shown, after which a check was reliable and near K*; NaN if none was."""
    for point in cell["curve"]:
        if point["success_rate"] >= RELIABLE and point["steps"] / k_check - 1 <= NEAR:
            return float(point["env_steps"] + point["expert_steps"])
    return float("nan")


def pairs(found: Scores) -> list[tuple[str, str]]:
    """Return problems and agents, one problem after the other, the agents in the order of NAMES."""
    problems = sorted({problem for problem, _, _ in found})
    known = dict.fromkeys((problem, agent) for problem, agent, _ in found)
    return [pair for problem in problems for pair in known if pair[0] == problem]


def runs_of(results: Row, problem: str, agent: str) -> list[Row]:
    """Return the cells of an agent."""
    return [cell for cell in results["cells"] if (cell["problem"], cell["agent"]) == (problem, agent)]


def approach(cell: Row, k_check: float) -> tuple[list[float], list[float]]:
    """Return the environment steps, flown and shown, of the reliable checks, and the least gap to K* until each."""
    good = [point for point in cell["curve"] if point["success_rate"] >= RELIABLE]
    steps = [float(point["env_steps"] + point["expert_steps"]) for point in good]
    gaps = [float(point["steps"] / k_check - 1) for point in good]
    return steps, list(accumulate(gaps, min))
