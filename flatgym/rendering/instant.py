"""A flight at an instant, as whoever draws it wants to know it; loads nothing that draws."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario

MARGIN = 0.7
"""What is seen beyond start, goal, hoops and ghost [m]."""
NEAR = 2.0
"""Floors and ceilings are seen if they are no farther than this from them [m]."""


@dataclass(frozen=True, eq=False)
class Instant:
    """How a flight stands.

    Attributes:
        states: flown so far, from the start on, shape (k+1, 5).
        thrusts: of the k steps flown [m/s^2], shape (k,).
        hoops_passed: how many.
        outcome: a word of flatgym.OUTCOMES.
        part: how much of the last step is flown, where it is seen in slow motion; the last state is the one then.
    """

    states: Array
    thrusts: Array
    hoops_passed: int = 0
    outcome: str = "flying"
    part: float = 1.0

    @property
    def steps(self) -> int:
        """Steps flown."""
        return len(self.thrusts)


def between(states: Array, steps: float) -> Array:
    """Return where a flight (n, 5) is after so many steps, not necessarily whole, or at its end, shape (5,)."""
    first = min(math.floor(steps), len(states) - 1)
    second, part = min(first + 1, len(states) - 1), steps % 1.0
    return (1 - part) * states[first] + part * states[second]


def box_of_interest(scenario: Scenario, ghost: Array | None) -> Array:
    """Return least x, least z, greatest x, greatest z of what is to be seen [m], shape (4,)."""
    rims = [rim for hoop in scenario.hoops for rim in hoop.rims]
    points = np.array([scenario.start, scenario.goal, *rims])
    if ghost is not None:
        points = np.concatenate([points, ghost[:, 0:2]])
    low, high = points.min(axis=0), points.max(axis=0)
    limits = (scenario.floor, scenario.ceiling)
    near = [limit for limit in limits if limit is not None and low[1] - NEAR <= limit <= high[1] + NEAR]
    low[1], high[1] = min([low[1], *near]), max([high[1], *near])
    return np.concatenate([low - MARGIN, high + MARGIN])
