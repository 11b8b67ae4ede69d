"""The batches' part of the solvers' benchmark: how many scenarios a second, and how they ended.

Each function answers one question in plain rows, as `experiments.measurements.solvers` wants its sections.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import optimal
from experiments.files import Row
from experiments.measurements.sections import Advance, random_goal

JOBS = 2
SOLVED, STEPPED = 1000, 200
"""Random goals solved, and flown in the fewest steps."""


def batch(quick: bool, advance: Advance) -> list[Row]:
    """How many random goals a second are solved and certified, and flown in the fewest steps?

    Wall times count everything: starting the workers, building their programs, handing the answers back.
    """
    sizes = {"solve_many": 4 if quick else SOLVED, "fewest_steps_many": 4 if quick else STEPPED}
    rows: list[Row] = []
    for name, size in sizes.items():
        generator, before = np.random.default_rng(11), sum(row["scenarios"] for row in rows)
        goals = [random_goal(generator, i) for i in range(size)]

        def tell(done: int, _: int, before: int = before) -> None:
            advance(before + done, sum(sizes.values()))

        many: Callable[..., Sequence[Any]] = getattr(optimal, name)
        begun = time.perf_counter()
        answers = many(goals, jobs=JOBS, progress=tell)
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
