"""What the sections of the solvers' benchmark share: rows, random goals, orders of convergence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from flatgym import Scenario

Row = dict[str, Any]
Advance = Callable[[int, int], None]
"""Called with what is done and what there is to do."""

REFERENCE_TIMES = {
    "horizontal-3": 0.8987,
    "horizontal-6": 1.23132,
    "horizontal-9": 1.48822,
    "horizontal-12": 1.70490,
    "horizontal-15": 1.89584,
    "ground-6": 1.23408,
    "diagonal": 1.4112,
    "hoop": 1.41143,
    "climb": 1.30037,
}
"""T* [s] found by other code and finer grids before this project."""
REACH = 10.0
"""Half the width of the square of random goals [m]."""


def random_goal(generator: np.random.Generator, number: int) -> Scenario:
    """Draw a goal in the square around the start, at least half a metre away."""
    while True:
        goal = generator.uniform(-REACH, REACH, 2)
        if np.hypot(*goal) >= 0.5:
            return Scenario(f"goal-{number}", (0.0, 0.0), (float(goal[0]), float(goal[1])))


def convergence_order(nodes: Sequence[int], errors: Any) -> float:
    """Return the slope of -log |error| over log nodes by least squares."""
    return float(-np.polyfit(np.log(nodes), np.log(np.abs(errors)), 1)[0])
