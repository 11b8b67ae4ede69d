"""Stages: the exclusion of one branch for one duration, as a proof stores it, and its check.

Each stage is one grid, the hoops of its chain, and multipliers. It cuts from the windows the time steps in which no
flight passes a hoop. The last stage leaves no flight. The windows follow from the stages, so a proof stores the stages
only.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flatgym.quadrotor import Array
from optimal.proof.branches import Branch
from optimal.proof.dual import Dual
from optimal.proof.programme.stations import Passing, Problem
from optimal.proof.programme.tilt_program import Grid
from optimal.proof.programme.time_grid import HoldGrid


class Stage(NamedTuple):
    """One step of an exclusion.

    Attributes:
        grid: instants and angles of the dynamic programme.
        hoops: the hoops of the chain, ascending. The others are ignored.
        multipliers: the multipliers of `optimal.proof.dual.Dual`.
    """

    grid: Grid
    hoops: tuple[int, ...]
    multipliers: Array


def passing_left(problem: Problem, branch: Branch, stages: Sequence[Stage], passing: Passing) -> Passing | None:
    """Return what stages leave of the passing times of the flights of a branch; None if they leave no flight.

    Everything is recomputed from the problem.

    Args:
        problem: the flights.
        branch: the class of flights.
        stages: the stages, in their order.
        passing: what is known of the passing times of all flights.

    Raises:
        ValueError: for a stage that does not belong to the problem.
    """
    passing = within(problem, branch, passing)
    for stage in stages:
        if not _admissible(problem, stage):
            raise ValueError(f"not a stage of this problem: {stage.grid}, hoops {stage.hoops}")
        dual = Dual(problem, stage.grid, branch, stage.hoops, passing.of(stage.hoops))
        y = stage.multipliers
        if not dual.apart or y.shape != (dual.size,) or not np.isfinite(y).all() or (y[dual.signed] < 0).any():
            raise ValueError(f"not the multipliers of a stage of this problem: {y}")
        left = dual.prune(y) if dual.possible else None
        if left is None:
            return None
        passing = passing.cut(stage.hoops, left)
    return passing


def within(problem: Problem, branch: Branch, passing: Passing) -> Passing:
    """Return what is known of the passing times of the flights of a branch."""
    for hoop, low, high in branch.passing:
        passing = passing.cut((hoop,), Passing(((low * problem.duration, high * problem.duration),), ()))
    return passing


def _admissible(problem: Problem, stage: Stage) -> bool:
    """Return whether grid and hoops of a stage belong to a problem."""
    grid, hoops = stage.grid, stage.hoops
    ascending = all(a < b for a, b in pairwise(hoops)) and set(hoops) <= {*problem.hoops}
    if isinstance(grid, HoldGrid):
        steps = grid.parts >= 1 and 0 < problem.steps * grid.parts == grid.steps and grid.step == problem.scenario.dt
    else:
        steps = grid.time >= problem.duration and grid.valid and grid.stride >= 1 and grid.steps % grid.stride == 0
    return ascending and grid.rate_max == problem.scenario.quadrotor.rate_max and steps
