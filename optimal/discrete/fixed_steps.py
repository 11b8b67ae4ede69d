"""A flight in a given number of environment steps, near a known flight, verified by replay in the environment.

The program of K steps (`optimal.discrete.program`) needs to know in which step each hoop is crossed. The first guess is
the step in which the known flight crosses it. Where the solution crosses a hoop at an end of its step, the crossing is
moved to the neighbouring step, and the program is solved again.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from flatgym.task.rollout import replay_to_goal
from optimal.direct.transcription import has_height_limits
from optimal.discrete import program
from optimal.flights.replay import crossing_times
from optimal.flights.trajectory import Trajectory

ARRIVAL_MARGIN = 1e-3
"""Distance of m from 1 that counts as arrived: float32 actions move the end by less."""
STEP_EDGE = 0.02
"""A crossing this near to an end of its step, as a share of the step, is moved to the neighbouring step."""
MAX_ROUNDS = 6
"""Most assignments of hoops to steps that are tried."""


class StepSolution(NamedTuple):
    """A flight verified by replay in the environment.

    Attributes:
        actions: the environment's actions, float32, shape (K, 2).
        states: the states, from start to goal, shape (K+1, 5).
        winding: whole turns of the tilt.
        tolerance_used: share of the tolerance that the flight needs, the square root of m.
    """

    actions: NDArray[np.float32]
    states: Array
    winding: int
    tolerance_used: float


def solve_in_steps(target: Scenario, flight: Trajectory, winding: int, count: int) -> StepSolution | None:
    """Return a flight of at most `count` steps near another one; None if none is found.

    Args:
        target: the task.
        flight: a flight through all hoops, of any duration.
        winding: whole turns of its tilt.
        count: K.
    """
    crossings = crossing_steps(target, flight, count)
    tried: set[tuple[int, ...]] = set()
    guess = program.first_guess(target, flight, count)
    rims = bool(target.hoops) and target.quadrotor.radius > 0
    margins = list(program.RIM_MARGINS) if rims else [0.0]
    while len(crossings) == len(target.hoops) and crossings not in tried and len(tried) < MAX_ROUNDS:
        tried.add(crossings)
        shape = program.StepShape(count, has_height_limits(target), crossings, rims)
        found = program.solve_program(target, shape, winding, guess, margins[0])
        if found.m <= 1 - ARRIVAL_MARGIN:
            actions = np.clip(target.quadrotor.action(found.controls), -1, 1).astype(np.float32)
            states = replay_to_goal(target, actions)
            if states is not None:
                return StepSolution(actions[: len(states) - 1], states, winding, math.sqrt(max(found.m, 0.0)))
            if len(margins) > 1:  # the body touched a rim between two constrained points
                margins.pop(0)
                tried.discard(crossings)
                continue
        shift = (found.shares > 1 - STEP_EDGE).astype(int) - (found.shares < STEP_EDGE)
        crossings = tuple(int(j) for j in np.clip(np.array(crossings, int) + shift, 0, count - 1))
    return None


def crossing_steps(target: Scenario, flight: Trajectory, count: int) -> tuple[int, ...]:
    """Return the step in which a flight, divided into `count` steps, crosses each hoop; fewer if it misses one."""
    times = crossing_times(flight, target) if target.hoops else np.zeros(0)
    return tuple(int(j) for j in np.clip(np.floor(times / flight.duration * count), 0, count - 1))
