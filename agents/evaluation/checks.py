"""TODO agents/evaluation/checks.py."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from agents.evaluation.rollouts import Flights
from flatgym.scenarios.reference import EVALUATION_SEED

VALIDATION_SEED = EVALUATION_SEED - 100_000
"""Seed of the flights of a check, which are neither those of training nor those that scores are flown on."""
Point = dict[str, Any]


def rank(point: Point) -> tuple[float, float]:
    """Return how good a point of a learning curve is: by success first, by steps then; greater is better."""
    return point["success_rate"], -point["steps"]


def outcome_of(flights: Flights) -> Point:
    """Return what a check says of flights: most frequent outcome, success rate, mean steps of those that succeeded."""
    succeeded = np.array([word == "goal" for word in flights.outcomes])
    steps = float(flights.steps[succeeded].mean() if succeeded.any() else flights.steps.mean())
    return {
        "outcome": Counter(flights.outcomes).most_common(1)[0][0],
        "success_rate": float(succeeded.mean()),
        "steps": int(steps) if steps.is_integer() else steps,
    }
