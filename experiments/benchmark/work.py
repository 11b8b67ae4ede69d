"""Learning against work: the gap that each learner reaches within so many samples, or within so much time.

A gap counts where validation has the target success. Of several runs it is the median; a run without such a validation
counts as infinite, so half of the runs must have one.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from statistics import median

from agents.evaluation.validation import Point
from experiments.benchmark.summary import TARGET_SUCCESS
from experiments.files import Row

SAMPLES = (1e5, 1e6, 1e7)
"""Numbers of samples, environment steps and expert labels, at which learners are compared."""
SECONDS = (60.0, 250.0, 900.0)
"""Training times at which learners are compared [s]."""


def spent(point: Point, work: str) -> float:
    """Return the work until a validation: "samples", environment steps and expert labels, or "seconds" of training."""
    return float(point["env_steps"] + point["expert_labels"] if work == "samples" else point["wall_time_s"])


def gap_within(cell: Row, validation_k_star: float, work: str, limit: float) -> float:
    """Return the smallest gap that a run reaches within a limit; inf where it has no validation of target success.

    Args:
        cell: the run.
        validation_k_star: K* of validation.
        work: "samples" or "seconds".
        limit: the most work.
    """
    within = (point for point in cell["curve"] if spent(point, work) <= limit)
    good = [point for point in within if point["success_rate"] >= TARGET_SUCCESS]
    return min((point["steps"] / validation_k_star - 1 for point in good), default=inf)


def median_gap(cells: Sequence[Row], validation_k_star: float, work: str, limit: float) -> float:
    """Return the median of `gap_within` over runs."""
    return float(median(gap_within(cell, validation_k_star, work, limit) for cell in cells))


def gaps_by_work(cells: Sequence[Row], validation_k_star: float) -> list[float]:
    """Return the median gaps of a learner at SAMPLES, then at SECONDS."""
    stages = [("samples", limit) for limit in SAMPLES] + [("seconds", limit) for limit in SECONDS]
    return [median_gap(cells, validation_k_star, *stage) for stage in stages]
