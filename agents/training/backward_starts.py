"""Start states for training, simulated backwards from the goal.

A policy that always starts at the scenario's start never reaches the goal and does not learn. The exact step is
invertible in time. States from which the goal is reached quickly are therefore sampled by simulating backwards from
the goal under random, mostly extreme controls (a time-optimal flight has bang-bang thrust and bang-singular rate). A
hoop crossed on the way counts as not yet passed. This needs neither demonstrations nor a planner.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flatgym.envs.config import Starts
from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Hoop, Scenario
from flatgym.task.scene import Integers

SPREAD = np.array([2.0, 2.0, 3.0, 3.0, 1.0])
"""Standard deviations of the states sampled around the goal [m, m, m/s, m/s, rad]."""
HOLD_TIME = 0.15
"""Mean time for which a control is held [s]."""


def backward_starts(
    scenario: Scenario,
    *,
    share: float = 0.8,
    near: float = 0.125,
    back_time: float = 1.0,
    turns: int = 0,
    seed: int = 0,
    size: int = 40_000,
) -> Starts:
    """Return a pool of start states for an environment; states out of bounds are replaced by the scenario's start.

    Args:
        scenario: the task.
        share: share of episodes that start from the pool, not at the scenario's start.
        near: share of the pool sampled around the goal; the rest is simulated backwards from it.
        back_time: longest time of the backward simulation [s].
        turns: whole turns of the tilt at the goal, where the simulation begins.
        seed: seed of the pool.
        size: number of states in the pool.
    """
    generator, count = np.random.default_rng(seed), round(size * near)
    around = scenario.goal_state + generator.normal(size=(count, 5)) * SPREAD * generator.random((count, 1))
    flown, still_to_pass = fly_back(generator, scenario, back_time * generator.random(size - count))
    state = np.concatenate([around, flown])
    state[:, 4] += 2 * np.pi * turns
    passed = np.concatenate([np.full(count, len(scenario.hoops)), still_to_pass])
    outside = _outside(scenario, state)
    return Starts(
        np.where(outside[:, None], scenario.start_state, state), np.where(outside, 0, passed).astype(np.int64), share
    )


def fly_back(generator: np.random.Generator, scenario: Scenario, time: Array) -> tuple[Array, Integers]:
    """Return states (n, 5) from which random controls reach the goal in `time` [s], shape (n,), and hoops passed (n,).

    Each control is at a limit with probability 0.7, else uniform. Thrust is then set to full with probability 0.6.
    """
    count, quadrotor = len(time), scenario.quadrotor
    state, passed = np.tile(scenario.goal_state, (count, 1)), np.full(count, len(scenario.hoops))
    remaining = time.copy()
    while (remaining > 0).any():
        h = np.minimum(remaining, generator.exponential(HOLD_TIME, count))
        sign = np.where(generator.random((count, 2)) < 0.5, -1.0, 1.0)
        size = np.where(generator.random((count, 2)) < 0.3, generator.random((count, 2)), 1.0)
        action = sign * size
        action[:, 0] = np.where(generator.random(count) < 0.6, 1.0, action[:, 0])
        before = quadrotor.step(state, quadrotor.control(action), -h)
        for i in reversed(range(len(scenario.hoops))):
            passed -= (passed == i + 1) & _crosses(scenario.hoops[i], before[:, 0:2], state[:, 0:2])
        state, remaining = before, remaining - h
    return state, passed


def _crosses(hoop: Hoop, here: Array, there: Array) -> NDArray[np.bool_]:
    """Return whether chords from here to there, shapes (n, 2), pass the hoop; exact arcs are not needed for starts."""
    before, after = (here - hoop.centre) @ hoop.direction, (there - hoop.centre) @ hoop.direction
    through = (before < 0) & (after >= 0)
    share = np.where(through, before / np.where(through, before - after, 1.0), 0.0)
    point = here + share[:, None] * (there - here) - hoop.centre
    return through & (np.abs(point @ hoop.across) < hoop.half_gap())


def _outside(scenario: Scenario, state: Array) -> NDArray[np.bool_]:
    low_x, low_z, high_x, high_z = scenario.bounds
    low_z, high_z = max(low_z, scenario.heights[0]), min(high_z, scenario.heights[1])
    x, z = state[:, 0], state[:, 1]
    return (x < low_x) | (x > high_x) | (z < low_z) | (z > high_z)
