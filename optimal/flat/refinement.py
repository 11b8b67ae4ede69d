"""From a slow start to a certified motion: eq. (10) solved on refined grids with tightened limits.

The program imposes limits at the checks of a grid. Four steps carry them over to continuous time.

1. Mesh refinement: intervals are split where limits are violated between checks or are not active.
2. Constraint tightening: the limits of an interval are tightened by the remaining violation, within a
   shrinking trust region.
3. Uniform time scaling slows the motion down by the last small violation (`optimal.flat.limits`).
4. Fallback: the slow motion along the central path (section II-E) is feasible whenever a corridor exists. It is
   the start of the solve, and the result if everything else fails.

A finite time is reported only with a motion whose limits were verified.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from heapq import heapify, heappush, heapreplace

import numpy as np

from flatgym.quadrotor import Array
from optimal.flat.initial_guess import first_solution, motion, slow_start
from optimal.flat.limits import constraint_violation, interval_violations, slowed_to_limits, sped_up_to_limits
from optimal.flat.problem import FIXED_PATH, LARGE_REGION, SMALL_REGION, Iterate, PlanningProblem, shared_points, spaces
from optimal.flat.program.parameters import LEAST_SQUARED_SPEED
from optimal.flat.program.solver import USABLE, solve_program
from optimal.flat.projection import Motion, projected
from optimal.flat.solution import FlatSolution, assessed
from optimal.flat.trajectory import FlatTrajectory

INTERVALS, REFINEMENT = 32, 2
"""Intervals of the first grid, and the factor by which a refined grid has more."""
FINE_ENOUGH = 2.5e-3
"""Violation between checks, relative to the limit, up to which the first grid is not refined."""
TIGHTENINGS, GAIN, MAX_MARGIN, SHRINKAGE = 10, 1.3, 0.4, 0.7
"""Most tightenings; margin added per violation; greatest margin; factor of the trust region at each tightening.
The trust region shrinks because a violation removed on one interval may otherwise reappear on a neighbour."""
SMALL_VIOLATION, LEAST_MARGIN, MAX_SLOWDOWN = 1e-3, 1e-4, 1.03
"""Violation up to which a motion is slowed down instead of solved again; least margin added where a limit is
violated; greatest factor of a slow-down."""
VALUE_CAP = 10.0
"""Limited quantities are capped at this multiple of their limit when intervals are compared."""


def optimise(
    problem: PlanningProblem, intervals: int, start: Motion | None = None, slowest: float = math.inf
) -> FlatSolution:
    """Solve a planning problem.

    Args:
        problem: the problem.
        intervals: intervals of the first grid, at least 4.
        start: a motion that is projected on the outer paths; None for the slow start.
        slowest: duration on the first grid from which a motion is not refined [s].

    Raises:
        ValueError: for fewer than 4 intervals, and a start that leaves the corridor.
    """
    if intervals < 4:
        raise ValueError(f"intervals must be at least 4, got {intervals}")
    begun = time.perf_counter()
    if start is None:
        slow = slow_start(problem, intervals)
        iterate = first_solution(problem, slow) if problem.certified else solve_program(problem, slow)
    else:
        near = projected(problem, start, np.linspace(0.0, 1.0, intervals + 1))
        iterate = solve_program(problem, near, trust_region=LARGE_REGION)
    first = motion(problem, iterate)
    if not problem.certified:
        return assessed(problem, iterate, first, begun, first.duration)
    if first.duration >= slowest:
        status = f"Not refined: {first.duration:.6g} s on the first grid, not less than slowest = {slowest:.6g} s."
        return replace(assessed(problem, iterate, None, begun, first.duration), status=status)
    flight = None
    if constraint_violation(first) <= FINE_ENOUGH:
        iterate, flight = _certified(problem, iterate)
    for region in (LARGE_REGION, SMALL_REGION, SMALL_REGION):
        if flight is not None:
            break
        finer = solve_program(problem, _refine_mesh(problem, iterate, REFINEMENT * intervals), trust_region=region)
        if finer.outcome in USABLE:
            iterate, flight = _certified(problem, finer)
    if flight is not None:
        return assessed(problem, iterate, flight, begun, first.duration)
    flight = _along_central_path(problem, slow) if start is None else None
    return assessed(problem, iterate, flight, begun, first.duration, optimised=False)


def _along_central_path(problem: PlanningProblem, slow: Iterate) -> FlatTrajectory | None:
    """Return the fallback: the path of the slow start, followed as fast as the limits allow."""
    _, flight = _certified(problem, solve_program(problem, slow, trust_region=FIXED_PATH))
    return flight or sped_up_to_limits(motion(problem, slow))


def _refine_mesh(problem: PlanningProblem, iterate: Iterate, intervals: int) -> Iterate:
    """Return the same motion on more intervals, bisecting the interval of greatest estimated loss repeatedly.

    The estimated loss of an interval is its violation plus its duration times the range of the limited
    quantities: a quantity that varies within an interval is not at its limit all along. The splines of nested
    grids are nested, so the motion is represented exactly.
    """
    flight, nodes = motion(problem, iterate), iterate.nodes
    inside = nodes[:-1, None] + np.diff(nodes)[:, None] * np.linspace(1e-6, 1 - 1e-6, 9)
    values = np.clip(np.nan_to_num(problem.system.limited_values(flight.jet(inside))), -VALUE_CAP, VALUE_CAP)
    losses = np.diff(flight.breakpoints) / flight.duration * np.ptp(values, axis=1).sum(axis=-1)
    losses += np.clip(interval_violations(flight).max(axis=(0, 1)), 0, 1)
    queue = [(-loss, begin, end) for loss, begin, end in zip(losses, nodes[:-1], nodes[1:], strict=True)]
    heapify(queue)
    while len(queue) < intervals:
        loss, begin, end = queue[0]
        middle = (begin + end) / 2
        heapreplace(queue, (loss / 2, begin, middle))
        heappush(queue, (loss / 2, middle, end))
    finer = np.array([*sorted(begin for _, begin, _ in queue), 1.0])
    before, after = (shared_points(grid, problem.certified) for grid in (nodes, finer))
    lifted = [np.interp(after, before, values) for values in iterate.lifted.T]
    weights, speed = spaces(problem.system, finer, problem.certified)
    return Iterate(
        finer,
        np.clip(weights.fitted(flight.weights), 0, 1),
        np.maximum(speed.fitted(flight.squared_speed) / problem.speed_unit, LEAST_SQUARED_SPEED),
        np.stack(lifted, axis=-1) if lifted else np.zeros((len(after), 0)),
        iterations=iterate.iterations,
    )


def _certified(problem: PlanningProblem, iterate: Iterate) -> tuple[Iterate, FlatTrajectory | None]:
    """Tighten the limits of each interval by the violation within it, and slow the motion down by the rest.

    Returns:
        The last iterate, and the fastest slowed-down motion; None where no iterate comes close enough to feasible.
    """
    margins = np.zeros((2, len(problem.system.bounds[0]), len(iterate.nodes) - 1))
    best: FlatTrajectory | None = None
    for i in range(TIGHTENINGS):
        if iterate.outcome not in USABLE:
            break
        flight = motion(problem, iterate)
        violations = interval_violations(flight)
        feasible = slowed_to_limits(flight, MAX_SLOWDOWN) if violations.max() < MAX_SLOWDOWN - 1 else None
        best = min((f for f in (best, feasible) if f is not None), key=lambda f: f.duration, default=None)
        if feasible is not None and violations.max() <= SMALL_VIOLATION:
            break
        spread = _spread(np.maximum(violations, 0.0))
        margins = np.minimum(margins + GAIN * spread + LEAST_MARGIN * (spread > 0), MAX_MARGIN)
        iterate = solve_program(problem, iterate, margins, SMALL_REGION.scaled(SHRINKAGE**i))
    return iterate, best


def _spread(violations: Array) -> Array:
    """Return the violation of each interval, or half of a neighbour's if that is greater.

    A violation removed on one interval tends to reappear on its neighbours.
    """
    beside = np.pad(violations, ((0, 0), (0, 0), (1, 1))) / 2
    return np.maximum(violations, np.maximum(beside[..., :-2], beside[..., 2:]))
