"""The data of one picture: an episode at an instant, and the region of interest. Independent of pygame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario

MARGIN = 0.7
"""Margin around start, goal, hoops and ghost [m]."""
NEAR = 2.0
"""Maximum distance from them at which floor and ceiling are shown [m]."""


@dataclass(frozen=True, eq=False)
class Instant:
    """An episode at an instant.

    Attributes:
        states: states from the start on, shape (k+1, 5).
        thrusts: thrusts of the k steps [m/s^2], shape (k,).
        hoops_passed: number of hoops passed.
        outcome: one of flatgym.OUTCOMES.
        part: elapsed fraction of the last step, for slow motion; the last state belongs to that time.
    """

    states: Array
    thrusts: Array
    hoops_passed: int = 0
    outcome: str = "flying"
    part: float = 1.0

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.thrusts)


def between(states: Array, steps: float) -> Array:
    """Return the state of a trajectory (n, 5) after a fractional number of steps, at most its last, shape (5,)."""
    first = min(math.floor(steps), len(states) - 1)
    second, part = min(first + 1, len(states) - 1), steps % 1.0
    return (1 - part) * states[first] + part * states[second]


def box_of_interest(scenario: Scenario, ghost: Array | None) -> Array:
    """Return minimum x, minimum z, maximum x, maximum z of the region to show [m], shape (4,)."""
    rims = [rim for hoop in scenario.hoops for rim in hoop.rims]
    points = np.array([scenario.start, scenario.goal, *rims])
    if ghost is not None:
        points = np.concatenate([points, ghost[:, 0:2]])
    low, high = points.min(axis=0), points.max(axis=0)
    limits = (scenario.floor, scenario.ceiling)
    near = [limit for limit in limits if limit is not None and low[1] - NEAR <= limit <= high[1] + NEAR]
    low[1], high[1] = min([low[1], *near]), max([high[1], *near])
    return np.concatenate([low - MARGIN, high + MARGIN])
