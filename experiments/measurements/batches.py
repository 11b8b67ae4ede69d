"""Measurements of batches: scenarios per second, and the statuses of their solutions.

The function is a section of `experiments.measurements.solvers`.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import optimal
from experiments.files import Row
from experiments.measurements.sections import Advance, uniform_goal

JOBS = 2
SOLVED, STEPPED = 1000, 200
"""Uniform goals solved for T*, and for K*."""


def batch(quick: bool, advance: Advance) -> list[Row]:
    """How many uniform goals a second are solved and certified, and solved for K*?

    Wall times include starting the workers, building their programs and returning the answers.
    """
    sizes = {"solve_many": 4 if quick else SOLVED, "fewest_steps_many": 4 if quick else STEPPED}
    rows: list[Row] = []
    for name, size in sizes.items():
        generator, before = np.random.default_rng(11), sum(row["scenarios"] for row in rows)
        goals = [uniform_goal(generator, i) for i in range(size)]

        def count(done: int, _: int, before: int = before) -> None:
            advance(before + done, sum(sizes.values()))

        many: Callable[..., Sequence[Any]] = getattr(optimal, name)
        begun = time.perf_counter()
        answers = many(goals, jobs=JOBS, progress=count)
        taken = time.perf_counter() - begun
        statuses = dict(Counter(answer.status.value for answer in answers))
        rows.append(
            {
                "what": name,
                "scenarios": size,
                "processes": JOBS,
                "wall_time_s": taken,
                "per_second": size / taken,
                "statuses": statuses,
            }
        )
    return rows
