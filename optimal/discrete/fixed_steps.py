"""A flight in a given number of environment steps, near a known flight, verified by replay in the environment.

The program of K steps (`optimal.discrete.program`) needs to know in which step each hoop is crossed. The first guess is
the step in which the known flight crosses it. Where the solution crosses a hoop at an end of its step, the crossing is
moved to the neighbouring step, and the program is solved again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from flatgym.task.rollout import replay_to_goal
from optimal.direct.transcription import CLOSE, PARALLEL, has_height_limits
from optimal.discrete import program
from optimal.flights.replay import crossing_times
from optimal.flights.trajectory import Trajectory

STEP_EDGE = 0.02
"""A crossing this near to an end of its step, as a share of the step, is moved to the neighbouring step."""
TOUCH = 1e-6
"""Distances to a gap that differ by less than this count as equal [m]."""
MAX_ROUNDS = 6
"""Most solves around one assignment of hoops to steps."""
NEIGHBOURS = (1, -1, 2, 3)
"""Steps by which all hoops are moved, in this order, while the solver does not converge."""
MAX_ASSIGNMENTS = 12
"""Number of assignments of hoops to steps after which the search with a number of steps ends."""


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


def solve_in_steps(
    target: Scenario, flight: Trajectory, winding: int, count: int, *, neighbours: Sequence[int] = NEIGHBOURS
) -> StepSolution | None:
    """Return a flight of at most `count` steps near another one; None if none is found.

    Args:
        target: the task.
        flight: a flight through all hoops, of any duration.
        winding: whole turns of its tilt.
        count: K.
        neighbours: as NEIGHBOURS; fewer give up earlier.
    """
    first, tried = crossing_steps(target, flight, count), set[tuple[int, ...]]()
    further = [separated(target, np.array(first) + offset, count) for offset in neighbours]
    for crossings in [first, separated(target, np.array(first), count, spare=1), *further]:
        found = _solve_around(target, flight, winding, count, crossings, tried)
        if isinstance(found, StepSolution):
            return found
        if found < math.inf or len(tried) >= MAX_ASSIGNMENTS:
            break
    return None


def remove_one_step(target: Scenario, best: StepSolution) -> StepSolution | None:
    """Return a flight of at least one step less near a flight in steps; None if none is found.

    The step is taken from one segment between start, hoops and goal after the other, the last one first: most flights
    can be shortened near the goal, where the tolerance is.
    """
    count, hoops = len(best.actions) - 1, np.arange(len(target.hoops))
    time, controls = target.dt * np.arange(count + 2.0), target.quadrotor.control(best.actions)
    flight = Trajectory(time, best.states, controls, target.quadrotor)
    passed, tried = np.array(crossing_steps(target, flight, count + 1)), set[tuple[int, ...]]()
    for segment in range(len(passed), -1, -1):
        crossings = separated(target, passed - (hoops >= segment), count)
        found = _solve_around(target, flight, best.winding, count, crossings, tried)
        if isinstance(found, StepSolution):
            return found
        if len(tried) >= MAX_ASSIGNMENTS:
            break
    return None


def _solve_around(
    target: Scenario,
    flight: Trajectory,
    winding: int,
    count: int,
    crossings: tuple[int, ...],
    tried: set[tuple[int, ...]],
) -> StepSolution | float:
    """Return a flight that crosses the hoops in given steps or near them, else the smallest m found.

    Args:
        target, flight, winding, count: as for `solve_in_steps`.
        crossings: the step in which each hoop is crossed.
        tried: assignments of hoops to steps that are left out; those tried are added.
    """
    rims = bool(target.hoops) and target.quadrotor.radius > 0
    margins, least = list(program.RIM_MARGINS) if rims else [0.0], math.inf
    for _ in range(MAX_ROUNDS):
        if crossings in tried:
            break
        shape = program.StepShape(count, has_height_limits(target), crossings, rims)
        guess = program.first_guess(target, flight, shape)
        found = program.solve_program(target, shape, winding, guess, margins[0])
        least = min(least, found.m)
        if found.m <= 1:  # The replay with float32 actions decides about values close to 1.
            actions = np.clip(target.quadrotor.action(found.controls), -1, 1).astype(np.float32)
            states = replay_to_goal(target, actions)
            if states is not None:
                return StepSolution(actions[: len(states) - 1], states, winding, math.sqrt(max(found.m, 0.0)))
            if len(margins) > 1:  # the body touched a rim between two constrained points
                margins.pop(0)
                continue
        tried.add(crossings)
        shift = (found.shares > 1 - STEP_EDGE).astype(int) - (found.shares < STEP_EDGE)
        crossings = separated(target, np.array(crossings) + shift, count)
    return least


def crossing_steps(target: Scenario, flight: Trajectory, count: int) -> tuple[int, ...]:
    """Return the step in which a flight, divided into `count` steps, crosses each hoop.

    A flight from a coarse grid may miss a hoop by less than a micrometre where it turns round. From there on the nodes
    nearest to the gaps stand for the crossings.
    """
    times = crossing_times(flight, target) if target.hoops else np.zeros(0)
    for hoop in target.hoops[len(times) :]:
        later = flight.breakpoints >= (times[-1] if times.size else 0.0)
        offset = flight.states[later, :2] - hoop.centre
        aside = np.maximum(np.abs(offset @ hoop.across) - hoop.diameter / 2, 0.0)
        distance = np.hypot(offset @ hoop.direction, aside)
        nearest = np.flatnonzero(distance <= distance.min() + TOUCH)[0]
        times = np.append(times, flight.breakpoints[later][nearest])
    return separated(target, np.floor(times / flight.duration * count), count)


def separated(target: Scenario, steps: Array, count: int, spare: int = 0) -> tuple[int, ...]:
    """Return steps in which hoops are crossed, moved apart where the flight has to turn round between two hoops.

    Between two parallel hoops of opposite directions it turns round once, which takes a step. Where the second of two
    parallel hoops of the same direction is not ahead of the first, it turns round twice. Free flights may do both in
    less than a step. `spare` steps are added where it turns round.
    """
    found = [int(j) for j in steps]
    for i in range(1, len(found)):
        before, hoop = target.hoops[i - 1], target.hoops[i]
        same = float(before.direction @ hoop.direction)
        if abs(float(before.across @ hoop.direction)) < PARALLEL:
            back = same > 0 and float((hoop.centre - before.centre) @ hoop.direction) <= CLOSE[0]
            turns = 2 if back else int(same < 0)
            found[i] = max(found[i], found[i - 1] + turns + (spare if turns else 0))
    return tuple(min(max(j, 0), count - 1) for j in found)
