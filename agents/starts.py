"""Start states for training: flown backwards from the goal.

An agent that always begins at the start never meets the goal and learns nothing. The exact step
runs backwards in time as well as forwards, so states from which the goal can be reached quickly
are drawn by leaving it backwards under random, mostly extreme controls (a time-optimal flight has
bang-bang thrust and bang-singular rate). A hoop crossed on the way counts as not yet passed. This
needs neither demonstrations nor a planner.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenario import Hoop, Scenario
from flatgym.scene import Integers

SPREAD = np.array([2.0, 2.0, 3.0, 3.0, 1.0])
"""Standard deviations of the states drawn around the goal [m, m, m/s, m/s, rad]."""
HOLD_TIME = 0.15
"""Mean time a control is held on the way back [s]."""


@dataclass
class BackwardStarts:
    """Draws start states for a batched environment from a fixed pool.

    Attributes:
        scenario: the task.
        share: share of flights that begin at a state of the pool, not at the scenario's own start; may
            be changed while training goes on.
        near: share of the pool drawn around the goal; the rest is flown backwards from it.
        back_time: longest time flown backwards [s].
        seed: of the pool.
        size: number of states in the pool.
    """

    scenario: Scenario
    share: float = 0.8
    near: float = 0.125
    back_time: float = 1.0
    seed: int = 0
    size: int = 40_000

    def __call__(self, generator: np.random.Generator, count: int) -> tuple[Array, Integers]:
        """Return start states (count, 5) and hoops already passed (count,)."""
        rows, drawn = generator.integers(0, self.size, count), generator.random(count) < self.share
        state, passed = self.pool
        return np.where(drawn[:, None], state[rows], self.scenario.start_state), np.where(drawn, passed[rows], 0)

    @cached_property
    def pool(self) -> tuple[Array, Integers]:
        """All states (size, 5) and hoops passed (size,) that may be drawn; the start where a draw was out of bounds."""
        generator, scenario = np.random.default_rng(self.seed), self.scenario
        near = round(self.size * self.near)
        around = scenario.goal_state + generator.normal(size=(near, 5)) * SPREAD * generator.random((near, 1))
        flown, still_to_pass = fly_back(generator, scenario, self.back_time * generator.random(self.size - near))
        state = np.concatenate([around, flown])
        passed = np.concatenate([np.full(near, len(scenario.hoops)), still_to_pass])
        outside = _outside(scenario, state)
        return np.where(outside[:, None], scenario.start_state, state), np.where(outside, 0, passed)


def fly_back(generator: np.random.Generator, scenario: Scenario, time: Array) -> tuple[Array, Integers]:
    """Return states (n, 5) from which random controls reach the goal in `time` [s], shape (n,), and hoops passed (n,).

    Thrust is more often full than not; both controls are extreme two times out of three.
    """
    count, quadrotor = len(time), scenario.quadrotor
    state, passed = np.tile(scenario.goal_state, (count, 1)), np.full(count, len(scenario.hoops))
    left = time.copy()
    while (left > 0).any():
        h = np.minimum(left, generator.exponential(HOLD_TIME, count))
        sign = np.where(generator.random((count, 2)) < 0.5, -1.0, 1.0)
        size = np.where(generator.random((count, 2)) < 0.3, generator.random((count, 2)), 1.0)
        action = sign * size
        action[:, 0] = np.where(generator.random(count) < 0.6, 1.0, action[:, 0])
        before = quadrotor.step(state, quadrotor.control(action), -h)
        for i in reversed(range(len(scenario.hoops))):
            passed -= (passed == i + 1) & _crosses(scenario.hoops[i], before[:, 0:2], state[:, 0:2])
        state, left = before, left - h
    return state, passed


def _crosses(hoop: Hoop, here: Array, there: Array) -> NDArray[np.bool_]:
    """Return whether the chords from here to there, shapes (n, 2), pass the hoop; close enough for a start."""
    before, after = (here - hoop.centre) @ hoop.direction, (there - hoop.centre) @ hoop.direction
    through = (before < 0) & (after >= 0)
    share = np.where(through, before / np.where(through, before - after, 1.0), 0.0)
    point = here + share[:, None] * (there - here) - hoop.centre
    return through & (np.abs(point @ hoop.across) < hoop.diameter / 2)


def _outside(scenario: Scenario, state: Array) -> NDArray[np.bool_]:
    low_x, low_z, high_x, high_z = scenario.bounds
    low_z = low_z if scenario.floor is None else max(low_z, scenario.floor)
    high_z = high_z if scenario.ceiling is None else min(high_z, scenario.ceiling)
    x, z = state[:, 0], state[:, 1]
    return (x < low_x) | (x > high_x) | (z < low_z) | (z > high_z)
