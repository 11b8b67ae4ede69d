"""Start states for training: flown backwards from the goal, as fast flights are flown.

An agent that always begins at the start never meets the goal and learns nothing. The exact step
runs backwards in time as well as forwards, so states from which the goal can be reached are drawn
by leaving the goal backwards: full thrust, now turning at full rate, now holding the tilt, which
is how time-optimal flights are built (bang-bang thrust, bang-singular rate). Hoops crossed on the
way count as not yet passed. This needs no demonstration and no planner.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenario import Hoop, Scenario
from flatgym.task import Integers

SPREAD = np.array([2.0, 2.0, 3.0, 3.0, 1.0])
"""Standard deviations of the states drawn near the goal [m, m, m/s, m/s, rad]."""
TURN_TIME, HOLD_TIME = 0.35, 0.4
"""Longest turn and mean time between turns [s]."""


@dataclass(frozen=True)
class BackwardStarts:
    """Draws start states for a batched environment: a fixed pool, sampled at every reset.

    Attributes:
        scenario: the task.
        near: share of the states drawn around the goal.
        back: share flown backwards from the goal; the rest are the scenario's own start.
        back_time: longest time flown backwards [s].
        seed: of the pool.
        size: number of states in the pool.
    """

    scenario: Scenario
    near: float = 0.1
    back: float = 0.7
    back_time: float = 1.0
    seed: int = 0
    size: int = 40_000

    def __call__(self, generator: np.random.Generator, count: int) -> tuple[Array, Integers]:
        """Return start states (count, 5) and hoops already passed (count,)."""
        rows = generator.integers(0, self.size, count)
        return self.pool[0][rows], self.pool[1][rows]

    @cached_property
    def pool(self) -> tuple[Array, Integers]:
        """All states (size, 5) and hoops passed (size,) that may be drawn."""
        generator, scenario = np.random.default_rng(self.seed), self.scenario
        near, back = round(self.size * self.near), round(self.size * self.back)
        state, passed = np.tile(scenario.start_state, (self.size, 1)), np.zeros(self.size, dtype=np.int64)
        state[:near] = scenario.goal_state + generator.normal(size=(near, 5)) * SPREAD * generator.random((near, 1))
        passed[:near] = len(scenario.hoops)
        flown = slice(near, near + back)
        state[flown], passed[flown] = fly_back(generator, scenario, generator.random(back) * self.back_time)
        outside = _outside(scenario, state)
        state[outside], passed[outside] = scenario.start_state, 0
        return state, passed


def fly_back(generator: np.random.Generator, scenario: Scenario, time: Array) -> tuple[Array, Integers]:
    """Return states (n, 5) `time` [s], shape (n,), before the goal on random fast flights, and hoops passed (n,)."""
    count, quadrotor = len(time), scenario.quadrotor
    state, passed = np.tile(scenario.goal_state, (count, 1)), np.full(count, len(scenario.hoops))
    left, turning = time.copy(), generator.random(count) < 0.8
    while (left > 0).any():
        turn, hold = generator.uniform(0.0, TURN_TIME, count), generator.exponential(HOLD_TIME, count)
        h = np.minimum(left, np.where(turning, turn, hold))
        thrust = np.where(generator.random(count) < 0.85, 1.0, generator.uniform(-1, 1, count))
        rate = np.where(turning, np.where(generator.random(count) < 0.5, -1.0, 1.0), 0.0)
        before = quadrotor.step(state, quadrotor.control(np.stack([thrust, rate], axis=-1)), -h)
        for i in reversed(range(len(scenario.hoops))):
            passed -= (passed == i + 1) & _crosses(scenario.hoops[i], before[:, 0:2], state[:, 0:2])
        state, left, turning = before, left - h, ~turning
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
