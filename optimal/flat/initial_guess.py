"""Initial guesses of eq. (10): the slow motion along the central path (section II-E), and the first solution."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from optimal.flat.limits import constraint_violation
from optimal.flat.problem import FIXED_PATH, LARGE_REGION, Iterate, PlanningProblem, shared_points, spaces
from optimal.flat.program.parameters import LEAST_SQUARED_SPEED
from optimal.flat.program.solver import SUCCESS, solve_program
from optimal.flat.trajectory import FlatTrajectory

INITIAL_SQUARED_SPEED = 0.05
"""The small b of section II-E [speed_unit]."""
UNIT_STEP, UNIT_STEPS, UNIT_INTERVALS = 4.0, 40, 16
"""Factor between the units of b that are tried, most of them, and intervals of the grid on which limits are sampled."""
SPURIOUS_VIOLATION = 1.0
"""A first solution that violates a limit between checks by more than this, relative to its scale, is rejected."""
TRUST_REGION_STEPS, LEAST_GAIN = 8, 1e-3
"""Most trust-region steps after a rejected first solution, and the relative gain in time below which they stop."""


def speed_unit(problem: PlanningProblem) -> float:
    """Return the greatest power of UNIT_STEP [1/s^2] in which the initial guess keeps all limits.

    Returns 1 if none of the first UNIT_STEPS powers upwards or downwards is the greatest.
    """
    start = central(problem, UNIT_INTERVALS)

    def feasible(unit: float) -> bool:
        return constraint_violation(motion(replace(problem, speed_unit=unit), start)) == 0

    powers = [UNIT_STEP**k for k in range(UNIT_STEPS)]
    if feasible(1.0):
        return next((unit for unit in powers if not feasible(unit * UNIT_STEP)), 1.0)
    return next((1 / unit for unit in powers if feasible(1 / unit)), 1.0)


def slow_start(problem: PlanningProblem, intervals: int) -> Iterate:
    """Return the initial guess of section II-E: the central path, slow enough to keep all limits."""
    start = central(problem, intervals)
    while constraint_violation(motion(problem, start)) > 0 and start.squared_speed[0] > LEAST_SQUARED_SPEED:
        start = replace(start, squared_speed=start.squared_speed / 4)
    return start


def central(problem: PlanningProblem, intervals: int) -> Iterate:
    """Return the central path at constant b: its weights blend smoothly from their start to their end values."""
    nodes = np.linspace(0.0, 1.0, intervals + 1)
    weight_space, speed_space = spaces(problem.system, nodes, problem.certified)
    share = weight_space.centres[:, None]
    blend = share**3 * (10 - 15 * share + 6 * share**2)
    weights = problem.ends[0] + (problem.ends[1] - problem.ends[0]) * blend
    lifted = np.tile(problem.system.lift().guess, (len(shared_points(nodes, problem.certified)), 1))
    return Iterate(nodes, weights[:, :-1], np.full(speed_space.size, INITIAL_SQUARED_SPEED), lifted)


def first_solution(problem: PlanningProblem, slow: Iterate) -> Iterate:
    """Return the solution on the first grid.

    The first attempt solves eq. (10) from the slow start. If it fails, eq. (8) is solved with the path fixed,
    which is easier, and then eq. (10) in a sequence of trust-region steps.
    """
    first = solve_program(problem, slow)
    if first.outcome in SUCCESS and constraint_violation(motion(problem, first)) <= SPURIOUS_VIOLATION:
        return first
    iterate = replace(solve_program(problem, slow, trust_region=FIXED_PATH), iterations=first.iterations)
    before = math.inf
    for _ in range(TRUST_REGION_STEPS):
        iterate = solve_program(problem, iterate, trust_region=LARGE_REGION)
        duration = motion(problem, iterate).duration
        if duration > before * (1 - LEAST_GAIN):
            break
        before = duration
    return iterate


def motion(problem: PlanningProblem, iterate: Iterate) -> FlatTrajectory:
    """Return the motion of an iterate."""
    weights, speed = spaces(problem.system, iterate.nodes, problem.certified)
    return FlatTrajectory(
        problem.system,
        problem.outer_paths,
        iterate.nodes,
        weights.spline(iterate.weights),
        speed.spline(problem.speed_unit * iterate.squared_speed),
    )
