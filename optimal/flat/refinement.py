"""From a slow start to a certified motion: how eq. (10) is solved, on grid after grid.

Limits hold at the checks of a grid, and motions happen between them. So the grid is laid out anew
where limits are exceeded between the checks or left unused, the limits are narrowed by what is
still exceeded, within a reach that shrinks, and in the end the motion is slowed by the last trace
of it. A time is only ever given with a motion that was measured. What is feasible whenever there
is a corridor, the central path at a slow pace (section II-E), is both the start and the last resort.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from heapq import heapify, heappush, heapreplace

import numpy as np

from flatgym.quadrotor import Array
from optimal.flat.problem import CLOSE, NEAR, PATH_HELD, Iterate, Problem, shared_points, spaces
from optimal.flat.program import SLOWEST, SUCCESS, USABLE, solve_program
from optimal.flat.trajectory import FlatTrajectory

INTERVALS, FINER = 32, 2
"""Intervals of the first grid, and how many times more a refined one has."""
RESOLVED = 1.5e-3
"""The violation between checks, relative to the limit, below which the first grid is fine enough."""
MISLED, STEPS, WORTH = 1.0, 8, 1e-3
"""The violation of a first solution that is none; how many steps are taken instead, while each gains so much."""
NARROWINGS, GAIN, WIDEST, CALM = 10, 1.3, 0.4, 0.7
"""How often limits are narrowed, by how many times what was exceeded, how far at most, and by what factor
the reach shrinks each time: else what is pushed back here comes up there, for ever."""
TRACE, LEAST, MOST_SLOWED = 1e-3, 1e-4, 1.03
"""The violation up to which a motion is slowed rather than solved again, the room made where that fails,
and how many times longer a slowed motion may take."""
SLOW = 0.05
"""The small b of section II-E [1/s^2]."""
WILD = 10.0
"""How many times its limit a quantity counts at most."""


@dataclass(frozen=True, eq=False)
class FlatSolution:
    """The answer of `plan` and `follow`.

    Attributes:
        time: duration of the motion [s]; inf unless converged.
        status: a sentence: how the solve ended, and what to do about it.
        converged: whether time and trajectory may be used as the status says.
        optimised: whether the motion is the optimiser's; else it is a feasible one along the central path.
        iterations: of Ipopt, over all the solves that led here.
        solve_time: wall time [s].
        trajectory: the motion; None unless converged.
        violation: largest violation of a limit in continuous time, relative to its scale; inf where
            there is no trajectory.
        intervals: of the grid.
    """

    time: float
    status: str
    converged: bool
    optimised: bool
    iterations: int
    solve_time: float
    trajectory: FlatTrajectory | None
    violation: float
    intervals: int


def optimise(problem: Problem, intervals: int) -> FlatSolution:
    """Return the solution of a problem, started on that many intervals."""
    if intervals < 4:
        raise ValueError(f"intervals must be at least 4, got {intervals}")
    begun = time.perf_counter()
    slow = slow_start(problem, intervals)
    if not problem.certified:
        iterate = solve_program(problem, slow)
        return _judged(problem, iterate, motion(problem, iterate), begun)
    iterate = _first(problem, slow)
    flight = None
    if motion(problem, iterate).violation() <= RESOLVED:
        iterate, flight = _certified(problem, iterate)
    for reach in (NEAR, CLOSE, CLOSE):
        if flight is not None:
            break
        finer = solve_program(problem, _refine_mesh(problem, iterate, FINER * intervals), reach=reach)
        if finer.outcome in USABLE:
            iterate, flight = _certified(problem, finer)
    if flight is not None:
        return _judged(problem, iterate, flight, begun)
    return _judged(problem, iterate, _along_central_path(problem, slow), begun, optimised=False)


def _along_central_path(problem: Problem, slow: Iterate) -> FlatTrajectory | None:
    """Return what is feasible whenever there is a corridor: the slow start's path, followed as fast as may be."""
    _, flight = _certified(problem, solve_program(problem, slow, reach=PATH_HELD))
    return flight or motion(problem, slow).hastened()


def _first(problem: Problem, slow: Iterate) -> Iterate:
    """Return the solution on the first grid: from the slow start at once, or where that fails by steps.

    The steps begin with the path held, eq. (8), the easier problem, and then let
    go of it little by little: the two stages of planning and following, and back again.
    """
    first = solve_program(problem, slow)
    if first.outcome in SUCCESS and motion(problem, first).violation() <= MISLED:
        return first
    iterate = replace(solve_program(problem, slow, reach=PATH_HELD), iterations=first.iterations)
    before = math.inf
    for _ in range(STEPS):
        iterate = solve_program(problem, iterate, reach=NEAR)
        duration = motion(problem, iterate).duration
        if duration > before * (1 - WORTH):
            break
        before = duration
    return iterate


def slow_start(problem: Problem, intervals: int) -> Iterate:
    """Return section II-E's start: centrally between the paths, so slowly that no limit is near."""
    start = central(problem, intervals)
    while motion(problem, start).violation() > 0 and start.squared_speed[0] > SLOWEST:
        start = replace(start, squared_speed=start.squared_speed / 4)
    return start


def central(problem: Problem, intervals: int) -> Iterate:
    """Return the motion whose weights pass smoothly from those at the start to those at the end."""
    nodes = np.linspace(0.0, 1.0, intervals + 1)
    weight_space, speed_space = spaces(problem.system, nodes, problem.certified)
    share = weight_space.centres[:, None]
    blend = share**3 * (10 - 15 * share + 6 * share**2)
    weights = problem.ends[0] + (problem.ends[1] - problem.ends[0]) * blend
    lifted = np.tile(problem.system.lift().guess, (len(shared_points(nodes, problem.certified)), 1))
    return Iterate(nodes, weights[:, :-1], np.full(speed_space.size, SLOW), lifted)


def motion(problem: Problem, iterate: Iterate) -> FlatTrajectory:
    """Return the motion an iterate describes."""
    weights, speed = spaces(problem.system, iterate.nodes, problem.certified)
    return FlatTrajectory(
        problem.system,
        problem.outer_paths,
        iterate.nodes,
        weights.spline(iterate.weights),
        speed.spline(iterate.squared_speed),
    )


def _refine_mesh(problem: Problem, iterate: Iterate, intervals: int) -> Iterate:
    """Return the same motion on more intervals, halving again and again the one that exceeds or wastes most.

    A quantity that varies within an interval is not at its limit all along; the time this may cost is
    the interval's duration times the quantities' range. (Nested splines: nothing is approximated.)
    """
    flight, nodes = motion(problem, iterate), iterate.nodes
    inside = nodes[:-1, None] + np.diff(nodes)[:, None] * np.linspace(1e-6, 1 - 1e-6, 9)
    values = np.clip(np.nan_to_num(problem.system.limited_values(flight.jet(inside))), -WILD, WILD)
    waste = np.diff(flight.breakpoints) / flight.duration * np.ptp(values, axis=1).sum(axis=-1)
    waste += np.clip(flight.excess().max(axis=(0, 1)), 0, 1)
    queue = [(-loss, begin, end) for loss, begin, end in zip(waste, nodes[:-1], nodes[1:], strict=True)]
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
        np.maximum(speed.fitted(flight.squared_speed), SLOWEST),
        np.stack(lifted, axis=-1) if lifted else np.zeros((len(after), 0)),
        iterations=iterate.iterations,
    )


def _certified(problem: Problem, iterate: Iterate) -> tuple[Iterate, FlatTrajectory | None]:
    """Narrow the limits of each interval by what was exceeded within it; slow the motion by the rest.

    Returns:
        The last iterate, and the fastest of the slowed motions; None where all are too far from feasible.
    """
    margins = np.zeros((2, len(problem.system.bounds[0]), len(iterate.nodes) - 1))
    best: FlatTrajectory | None = None
    for i in range(NARROWINGS):
        if iterate.outcome not in USABLE:
            break
        flight = motion(problem, iterate)
        excess = flight.excess()
        slowed = flight.slowed(MOST_SLOWED)
        best = min((f for f in (best, slowed) if f is not None), key=lambda f: f.duration, default=None)
        if slowed is not None and excess.max() <= TRACE:
            break
        exceeded = _spread(np.maximum(excess, 0.0))
        margins = np.minimum(margins + GAIN * exceeded + LEAST * (exceeded > 0), WIDEST)
        iterate = solve_program(problem, iterate, margins, CLOSE.times(CALM**i))
    return iterate, best


def _spread(excess: Array) -> Array:
    """Return the excess of each interval, or half of a neighbour's: pushed back here, it tends to come up there."""
    beside = np.pad(excess, ((0, 0), (0, 0), (1, 1))) / 2
    return np.maximum(excess, np.maximum(beside[..., :-2], beside[..., 2:]))


def _judged(
    problem: Problem, iterate: Iterate, flight: FlatTrajectory | None, begun: float, optimised: bool = True
) -> FlatSolution:
    """Return a time only for what may be called a solution, else the reason why not."""
    size = len(iterate.nodes) - 1
    ended = "" if iterate.outcome in SUCCESS else f" (Ipopt stopped with {iterate.outcome})"
    way_out = "start on another number of intervals, or use outer paths that leave more room"
    if flight is None or (not problem.certified and ended):
        flight = None
        status = f"Not solved: no motion within the limits was found on {size} intervals{ended}; {way_out}."
    elif not problem.certified:
        status = (
            "Limits at grid nodes only, as published: between them one is exceeded by "
            f'{flight.violation():.3g} times its value, so this is not a flight; use checks="certified" for one.'
        )
    elif optimised:
        status = f"Solved: limits hold in continuous time, on {size} intervals."
    else:
        status = (
            "Feasible, not optimal: limits hold in continuous time near the central path, but the optimiser found "
            f"nothing better on {size} intervals{ended}; {way_out}."
        )
    return FlatSolution(
        time=math.inf if flight is None else flight.duration,
        status=status,
        converged=flight is not None,
        optimised=flight is not None and optimised,
        iterations=iterate.iterations,
        solve_time=time.perf_counter() - begun,
        trajectory=flight,
        violation=math.inf if flight is None else flight.violation(),
        intervals=size,
    )
