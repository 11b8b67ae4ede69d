"""From a direct solution's costates to the multipliers of its dual: where every proof begins.

The costate of velocity is the weight q, that of position less its slope; where a hoop is passed or a height
touched, the slope jumps. A flight that is optimal to solver precision so comes with multipliers that are optimal to
the same precision, and prove most of its optimality at once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.direct.shooting import ShootingSolution

KINKS = tuple(k / 16 for k in range(1, 16))
"""Where q may bend at floor and ceiling, as shares of T, besides where the flight found touches them."""
TOUCHES = 1e-3
"""A jump of the costate this great, relative to the costate, is a touch of floor or ceiling."""


def active_heights(shot: ShootingSolution) -> Array:
    """Return how much the costate of height jumps at the end of each step, where it touches floor or ceiling, (N,)."""
    slopes = shot.costates[:, 1]
    jumps = np.diff(slopes, append=slopes[-1])
    jumps[np.cumsum(shot.steps)[:-1] - 1] = 0.0  # those are the hoops'
    return np.where(np.abs(jumps) > TOUCHES * np.abs(shot.costates[:, 0:2]).max(), jumps, 0.0)


def kink_shares(scenario: Scenario, shot: ShootingSolution) -> tuple[float, ...]:
    """Return where q may bend at floor and ceiling, as shares of T; none where there is neither."""
    if scenario.floor is None and scenario.ceiling is None:
        return ()
    touched = shot.trajectory.breakpoints[1:][active_heights(shot) != 0] / shot.trajectory.duration
    return tuple(sorted({*KINKS, *touched.tolist()}))


def multipliers(scenario: Scenario, shot: ShootingSolution, kinks: Sequence[float]) -> Array:
    """Return the multipliers of `optimal.proof.dual.Dual` that a direct solution's costates stand for, shape (size,).

    Args:
        scenario: what was flown.
        shot: the direct solution, on any grid.
        kinks: where q may bend at floor and ceiling, as shares of T.
    """
    costates, breakpoints = shot.costates, shot.trajectory.breakpoints
    slopes, duration = -costates[:, 0:2] * breakpoints[-1], breakpoints[-1]
    crossings = np.cumsum(shot.steps)[:-1]
    begin = costates[0, 2:4] - slopes[0] * breakpoints[1] / duration
    hoops = slopes[crossings] - slopes[crossings - 1]
    jumps, shares = active_heights(shot), breakpoints[1:] / duration
    bends = []
    for sign, height in ((1.0, scenario.floor), (-1.0, scenario.ceiling)):
        strength = np.zeros(len(kinks) if height is not None else 0)
        for k in np.flatnonzero(jumps) if strength.size else ():
            strength[np.argmin(np.abs(kinks - shares[k]))] += max(0.0, -sign * jumps[k] * duration)
        bends.append(strength)
    penalties = np.abs(costates[[0, -1], 4]) * scenario.quadrotor.rate_max / scenario.quadrotor.thrust_max
    return np.concatenate([begin, slopes[0], hoops.ravel(), *bends, penalties])
