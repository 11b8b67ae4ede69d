"""Initial multipliers of a proof, from the costates of a direct solution.

The costate of velocity is the weight q, and the costate of position is minus its slope. The slope jumps where a hoop
is passed and where floor or ceiling is active. The multipliers of a flight that is optimal to solver precision are
optimal to the same precision. They prove most of its optimality in the first evaluation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.direct.shooting import ShootingSolution

KINKS = tuple(k / 16 for k in range(1, 16))
"""Times at which the slope of q may jump at floor and ceiling, as shares of T, in addition to the flight's own."""
ACTIVE_JUMP = 1e-3
"""Jump of the position costate, relative to its largest value, from which floor or ceiling counts as active."""


def active_heights(shot: ShootingSolution) -> Array:
    """Return the jump of the height costate at the end of each step where floor or ceiling is active, shape (N,).

    The jump is zero at all other steps.
    """
    slopes = shot.costates[:, 1]
    jumps = np.diff(slopes, append=slopes[-1])
    jumps[np.cumsum(shot.steps)[:-1] - 1] = 0.0  # jumps at hoops
    return np.where(np.abs(jumps) > ACTIVE_JUMP * np.abs(shot.costates[:, 0:2]).max(), jumps, 0.0)


def kink_shares(scenario: Scenario, shot: ShootingSolution) -> tuple[float, ...]:
    """Return the times at which the slope of q may jump at floor and ceiling, as shares of T; empty without either."""
    if scenario.floor is None and scenario.ceiling is None:
        return ()
    active = shot.trajectory.breakpoints[1:][active_heights(shot) != 0] / shot.trajectory.duration
    return tuple(sorted({*KINKS, *active.tolist()}))


def multipliers(scenario: Scenario, shot: ShootingSolution, kinks: Sequence[float]) -> Array:
    """Return the multipliers of `optimal.proof.dual.Dual` given by the costates of a direct solution, shape (size,).

    Args:
        scenario: the task.
        shot: its direct solution, on any grid.
        kinks: times at which the slope of q may jump at floor and ceiling, as shares of T.
    """
    costates, breakpoints = shot.costates, shot.trajectory.breakpoints
    duration, crossings = breakpoints[-1], np.cumsum(shot.steps)[:-1]
    jumps, shares = active_heights(shot), breakpoints[1:] / duration
    bends, signs = [], []
    for sign, height in ((1.0, scenario.floor), (-1.0, scenario.ceiling)):
        strength = np.zeros(len(kinks) if height is not None else 0)
        for k in np.flatnonzero(jumps) if strength.size else ():
            strength[np.argmin(np.abs(kinks - shares[k]))] += max(0.0, -sign * jumps[k] * duration)
        bends.append(strength)
        signs.append(sign * strength)
    begin = costates[0, 2:4] + costates[0, 0:2] * breakpoints[1]
    stations = np.array([begin, *costates[crossings - 1, 2:4], costates[-1, 2:4]])
    # The kinks are not part of lambda.
    passing = np.array([0.0, *shares[crossings - 1], 1.0])
    for strength in signs:
        if strength.size:
            stations[:, 1] -= np.maximum(passing[:, None] - np.array(kinks), 0.0) @ strength
    penalties = np.abs(costates[[0, -1], 4]) * scenario.quadrotor.rate_max / scenario.quadrotor.thrust_max
    return np.concatenate([stations.ravel(), *bends, penalties])


def active_hoops(shot: ShootingSolution) -> tuple[int, ...]:
    """Return the hoops at which the position costate jumps: the others hardly matter to the flight time."""
    slopes, crossings = shot.costates[:, 0:2], np.cumsum(shot.steps)[:-1]
    jumps = np.hypot(*(slopes[crossings] - slopes[crossings - 1]).T)
    return tuple(np.flatnonzero(jumps > ACTIVE_JUMP * np.abs(slopes).max()).tolist())
