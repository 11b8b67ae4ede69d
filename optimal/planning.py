"""Path planning and path following as one fixed-end problem, paper eq. (10).

The flight is y(s) = p(s) y_1(s) + (1 - p(s)) y_2(s), travelled with ds/dt = sqrt(b(s)), and

    minimise    T = integral of ds / sqrt(b)                                                (7)
    subject to  0 <= p <= 1,  b > 0,  thrust and rate within their limits,                  (10)
                at rest and upright at s = 0 and s = 1.

(The paper misprints the time element as ds/sqrt(s).) `optimal.flat_program` is the transcription.

Limits hold at checks, and flights happen between them. `checks="nodes"` is the paper's
discretisation and lies. `checks="certified"` checks both ends and the middle of each interval,
refines the grid where it costs time, then measures what is exceeded between the checks and narrows
the limits there until nothing is. A time is only ever given with a flight that was measured.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline

from flatgym.quadrotor import Array, Quadrotor
from optimal.flat_program import SLOWEST, SUCCESS, Iterate, Problem, knots, place_checks, solve_program
from optimal.flat_trajectory import FlatTrajectory
from optimal.paths import OuterPaths, PaperPaths, paper_outer_paths

__all__ = ["FlatSolution", "PaperPaths", "paper_outer_paths", "plan"]

DEFAULT_QUADROTOR = Quadrotor()
DEFAULT_INTERVALS = {"certified": 100, "nodes": 50}
ALLOWED_VIOLATION = 1e-6
"""The largest violation of a limit, relative to it, that may be called none."""
SLOW = 0.05
"""The small b of section II-E, so slow that no limit is near [1/s^2]."""
COARSEST, GROWTH = 48, 1.6
"""The grid is refined from at most so many intervals, by at most this factor at a time."""
NARROWINGS, GAIN, LEAST = 15, 1.5, 3e-4
"""How often limits are narrowed, and by how much: by more than was exceeded, and never by less than that."""


@dataclass(frozen=True, eq=False)
class FlatSolution:
    """The answer of `plan`.

    Attributes:
        time: flight time [s]; inf unless converged.
        status: a sentence: how the solve ended, and what to do about it.
        converged: whether time and trajectory may be used as the status says.
        iterations: of Ipopt, over all the solves that led here.
        solve_time: wall time [s].
        trajectory: the flight; None unless converged.
        violation: largest violation of a control limit in continuous time, relative to the limit; inf
            where there is no trajectory.
    """

    time: float
    status: str
    converged: bool
    iterations: int
    solve_time: float
    trajectory: FlatTrajectory | None
    violation: float


def _slow_start(problem: Problem, intervals: int) -> Iterate:
    """Return section II-E's start: from end weight to end weight, centrally, upright and slowly."""
    nodes = np.linspace(0.0, 1.0, intervals + 1)
    checks = place_checks(nodes, problem.certified)
    ends = knots(nodes, 3)
    share = (ends[1:-3] + ends[2:-2] + ends[3:-1]) / 3
    share = share**3 * (10 - 15 * share + 6 * share**2)
    weight = problem.ends[0] + (problem.ends[1] - problem.ends[0]) * share
    count = len(checks.s)
    hover = np.full(count, problem.quadrotor.gravity)
    return Iterate(checks, weight, np.full(intervals + 2, SLOW), np.zeros(count), hover)


def _trajectory(problem: Problem, iterate: Iterate) -> FlatTrajectory:
    nodes = iterate.checks.nodes

    def powers(coefficients: Array, degree: int) -> Array:
        spline = BSpline(knots(nodes, degree), coefficients, degree)
        return np.array([spline(nodes[:-1], nu=k) / math.factorial(k) for k in range(degree + 1)])

    weight, squared_speed = powers(iterate.weight, 3), powers(iterate.squared_speed, 2)
    return FlatTrajectory(nodes, weight, squared_speed, problem.outer_paths, problem.quadrotor)


def _refined(problem: Problem, iterate: Iterate, intervals: int) -> Iterate:
    """Return the same flight on more intervals, halving those that lose most time.

    A control that varies within an interval is not at its limit all along; the time this may cost
    is the interval's duration times its controls' range. (Nested splines: nothing is approximated.)
    """
    flight, vehicle, nodes = _trajectory(problem, iterate), problem.quadrotor, iterate.checks.nodes
    t = flight.breakpoints[:-1, None] + np.diff(flight.breakpoints)[:, None] * np.linspace(1e-6, 1 - 1e-6, 9)
    spread = np.ptp(flight.control(t), axis=1) / (vehicle.control_high - vehicle.control_low)
    loss = np.diff(flight.breakpoints) * spread.sum(axis=1)
    chosen = np.argsort(-loss, kind="stable")[: intervals - len(nodes) + 1]
    finer = np.sort(np.concatenate([nodes, (nodes[chosen] + nodes[chosen + 1]) / 2]))
    dense = np.unique(np.linspace(finer[:-1], finer[1:], 5))

    def insert(coefficients: Array, degree: int) -> Array:
        values = BSpline(knots(nodes, degree), coefficients, degree)(dense)
        return np.asarray(make_lsq_spline(dense, values, knots(finer, degree), degree).c)

    weight, squared_speed = insert(iterate.weight, 3), insert(iterate.squared_speed, 2)
    checks = place_checks(finer, problem.certified)
    tilt, thrust = (np.interp(checks.s, iterate.checks.s, v) for v in (iterate.tilt, iterate.thrust))
    weight, squared_speed = np.clip(weight, 0, 1), np.maximum(squared_speed, SLOWEST)
    return Iterate(checks, weight, squared_speed, tilt, thrust, iterations=iterate.iterations)


def _certify(problem: Problem, iterate: Iterate) -> Iterate:
    """Narrow the limits of each interval by what was exceeded within it, until nothing is."""
    vehicle = problem.quadrotor
    margins = np.zeros((3, len(iterate.checks.nodes) - 1))
    most = 0.4 * np.array([[vehicle.thrust_max - vehicle.thrust_min]] * 2 + [[vehicle.rate_max]])
    for _ in range(NARROWINGS):
        flight = _trajectory(problem, iterate)
        if iterate.outcome not in SUCCESS or flight.violation() <= ALLOWED_VIOLATION:
            break
        excess = flight.excess()
        margins = np.minimum(margins + np.where(excess > 0, GAIN * excess + LEAST, 0.0), most)
        iterate = solve_program(problem, iterate, margins)
    return iterate


def plan(
    outer_paths: OuterPaths,
    quadrotor: Quadrotor = DEFAULT_QUADROTOR,
    *,
    ends: tuple[float, float] = (0.5, 0.5),
    intervals: int | None = None,
    checks: str = "certified",
) -> FlatSolution:
    """Return the fastest flight between two outer paths, from rest to rest and upright at both ends.

    Args:
        outer_paths: two paths answering `path(s, order)`, three times differentiable, at rest (y' = 0)
            at s = 0 and 1; `optimal.paths` has the paper's.
        quadrotor: the vehicle and its limits.
        ends: the weights p_1(0), p_1(1) of the first path where the flight begins and ends.
        intervals: pieces of p and b; by default 100, and 50 with limits at nodes only, where more are
            no better: the lie only has more places to hide, and the solver more to get lost in.
        checks: "certified": limits hold in continuous time, to 1e-6 relative; "nodes": as published,
            at grid nodes only, with what happens in between as the solution's violation.

    Returns:
        The solution; where the solve fails its time is inf and its status says why.

    Raises:
        ValueError: for arguments that describe no problem.

    Source: eq. (10), started as section II-E proposes.
    """
    intervals = DEFAULT_INTERVALS.get(checks, 0) if intervals is None else intervals
    _require_valid(outer_paths, ends, intervals, checks)
    begun = time.perf_counter()
    problem = Problem(outer_paths, quadrotor, ends, checks == "certified")
    if not problem.certified:
        iterate = solve_program(problem, _slow_start(problem, intervals))
        return _judged(problem, iterate, time.perf_counter() - begun)
    iterates = _on_finer_grids(problem, intervals)
    # The finest grid first; one too fine for the solver must not lose what a coarser one has found.
    for iterate in reversed(iterates):
        solution = _judged(problem, _certify(problem, iterate), time.perf_counter() - begun)
        if solution.converged:
            break
    return solution


def _on_finer_grids(problem: Problem, intervals: int) -> list[Iterate]:
    """Solve on grid after grid, e.g. 40, 63, 100 intervals, each started from the one before."""
    sizes = [intervals]
    while sizes[0] > COARSEST:
        sizes.insert(0, math.ceil(sizes[0] / GROWTH))
    iterates: list[Iterate] = []
    for size in sizes:
        known = [iterate for iterate in iterates if iterate.outcome in SUCCESS]
        start = _refined(problem, known[-1], size) if known else _slow_start(problem, size)
        iterates.append(solve_program(problem, start))
    return iterates


def _judged(problem: Problem, iterate: Iterate, solve_time: float) -> FlatSolution:
    """Return a time only for what may be called a solution, else the reason why not."""
    iterations, size = iterate.iterations, len(iterate.checks.nodes) - 1
    flight = _trajectory(problem, iterate)
    violation = flight.violation() if iterate.outcome in SUCCESS else math.inf
    if iterate.outcome not in SUCCESS:
        status = (
            f"Not solved: Ipopt stopped with {iterate.outcome} on {size} intervals; try another number of "
            "intervals, or outer paths that leave more room."
        )
    elif not problem.certified:
        status = (
            f"Limits at grid nodes only, as published: between them one is exceeded by {violation:.3g} times "
            'its value, so this is not a flight; use checks="certified" for one.'
        )
        return FlatSolution(flight.duration, status, True, iterations, solve_time, flight, violation)
    elif violation > ALLOWED_VIOLATION:
        status = (
            f"Not solved: between its checks the flight still exceeds a limit by {violation:.2%} after "
            f"{NARROWINGS} narrowings on {size} intervals; use more intervals."
        )
    else:
        status = f"Solved: limits hold in continuous time, on {size} intervals."
        return FlatSolution(flight.duration, status, True, iterations, solve_time, flight, violation)
    return FlatSolution(math.inf, status, False, iterations, solve_time, None, math.inf)


def _require_valid(outer_paths: OuterPaths, ends: tuple[float, float], intervals: int, checks: str) -> None:
    if checks not in DEFAULT_INTERVALS:
        raise ValueError(f'checks must be "certified" or "nodes", got {checks!r}')
    if intervals < 4:
        raise ValueError(f"intervals must be at least 4, got {intervals}")
    if len(outer_paths) != 2:
        raise ValueError(f"outer_paths must be two paths, got {len(outer_paths)}")
    if len(ends) != 2 or not all(0 <= end <= 1 for end in ends):
        raise ValueError(f"ends must be two weights of the first path between 0 and 1, got {ends}")
    for s, p in zip((0.0, 1.0), ends, strict=True):
        slope = p * outer_paths[0](s, 1) + (1 - p) * outer_paths[1](s, 1)
        if np.abs(slope).max() > 1e-9:
            raise ValueError(
                f"the outer paths must be at rest at both ends (y' = 0, section II-E), got y' = {slope} at s = {s:g}; "
                "reparametrise them, for example by the polynomial q(s) of section III-A"
            )
