"""What the sections of the solvers' benchmark share: rows, random goals, orders of convergence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from flatgym import Scenario

Row = dict[str, Any]
Advance = Callable[[int, int], None]
"""Called with what is done and what there is to do."""

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
