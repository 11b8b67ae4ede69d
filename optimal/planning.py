"""Path planning and path following as one fixed-end problem, paper eq. (10).

The flight is y(s) = p(s) y_1(s) + (1 - p(s)) y_2(s), travelled with ds/dt = sqrt(b(s)), and

    minimise    T = integral of ds / sqrt(b)                                                (7)
    subject to  0 <= p <= 1,  b > 0,  thrust and rate within their limits,                  (10)
                at rest and upright at s = 0 and s = 1.

(The paper misprints the time element as ds/sqrt(s).) On N intervals the controls p''' and b'' are
constant, so p is a cubic and b a quadratic spline. Their B-spline coefficients are the unknowns:
continuity is then exact, and coefficients within [0, 1] keep p there everywhere, not at nodes only.

Tilt theta and thrust f stand as variables at every check, tied to the path by

    x'' = f sin(theta),   z'' + g = f cos(theta),   rate = (x''' cos(theta) - z''' sin(theta)) / f,

which is the flat input of section II-A with its misprint corrected, and makes every limit a box.
It also makes the problem connected. Admissible thrust vectors fill a ring; between two checks the
vector could cut through its hole, turning by half a turn in no time. So between checks the tilt
may turn by no more than rate_max times the time that passes, which every true flight obeys.

Limits hold at checks, and flights happen between them. `checks="nodes"` is the paper's
discretisation and lies. `checks="certified"` checks both ends and the middle of each interval,
measures what is exceeded in between, and narrows the limits there until nothing is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

from flatgym.quadrotor import Array, Quadrotor
from optimal.flat_trajectory import FlatTrajectory
from optimal.paths import OuterPaths, PaperPaths, paper_outer_paths

__all__ = ["FlatSolution", "PaperPaths", "paper_outer_paths", "plan"]

DEFAULT_QUADROTOR = Quadrotor()
ALLOWED_VIOLATION = 1e-6
SLOW = 0.05
"""The small b of section II-E: so slow that no limit is near [1/s^2]."""
COARSEST, GROWTH = 48, 1.6
"""The grid is refined from at most so many intervals, by at most this factor at a time."""
NARROWINGS, GAIN, LEAST = 15, 1.5, 1e-4
"""How often limits are narrowed, and by how much: by more than was exceeded, and never by less than that."""
SUCCESS = "Solve_Succeeded"
IPOPT = {"print_level": 0, "sb": "yes", "max_iter": 800, "tol": 1e-8, "mu_strategy": "adaptive"}
OPTIONS: dict[str, Any] = {"print_time": False, "ipopt": IPOPT, "calc_lam_p": False, "no_nlp_grad": True}


@dataclass(frozen=True, eq=False)
class FlatSolution:
    """The answer of `plan`.

    Attributes:
        time: flight time [s]; inf unless converged.
        status: a sentence: how the solve ended, and what to do about it.
        converged: whether time and trajectory may be used as the status says.
        iterations: of Ipopt, over all solves.
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


@dataclass(frozen=True, eq=False)
class _Checks:
    """Where limits are checked: states at `s`, in `interval`; rates at check `point` of interval `owner`.

    Third derivatives jump at nodes, so a node between two certified intervals has two rates.
    """

    nodes: Array
    s: Array
    interval: NDArray[np.intp]
    point: NDArray[np.intp]
    owner: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class _Iterate:
    """A point of the program on its grid: coefficients of p and b, tilt and thrust at the checks."""

    checks: _Checks
    weight: Array
    squared_speed: Array
    tilt: Array
    thrust: Array
    outcome: str = "start"
    iterations: int = 0


@dataclass(frozen=True, eq=False)
class _Problem:
    """What is to be solved, on whatever grid."""

    outer_paths: OuterPaths
    quadrotor: Quadrotor
    ends: tuple[float, float]
    certified: bool
    log: list[int] = field(default_factory=list)


def _place_checks(nodes: Array, certified: bool) -> _Checks:
    count = len(nodes) - 1
    per = 2 if certified else 1
    index = np.arange(per * count + 1)
    interval = np.minimum(index // per, count - 1)
    s = np.interp(index / per, np.arange(count + 1), nodes)
    if not certified:
        return _Checks(nodes, s, interval, index, interval)
    owner = np.repeat(np.arange(count), 3)
    return _Checks(nodes, s, interval, 2 * owner + np.tile([0, 1, 2], count), owner)


def _knots(nodes: Array, degree: int) -> Array:
    return np.concatenate([[nodes[0]] * degree, nodes, [nodes[-1]] * degree])


def _local_basis(nodes: Array, degree: int, interval: NDArray[np.intp], s: Array, order: int) -> Array:
    """Return derivatives of the degree + 1 B-splines that live on each interval, shape (len(s), degree + 1)."""
    splines = BSpline(_knots(nodes, degree), np.eye(len(nodes) + degree - 1), degree)
    return np.asarray(splines(s, nu=order)[np.arange(len(s))[:, None], interval[:, None] + np.arange(degree + 1)])


def _data(problem: _Problem, checks: _Checks) -> list[Array]:
    """Return what the program of one shape needs to know of grid, paths and vehicle, in this order."""
    nodes, s, interval = checks.nodes, checks.s, checks.interval
    every, middle = np.arange(len(nodes) - 1), (nodes[1:] + nodes[:-1]) / 2
    first, second = problem.outer_paths
    below = [second(s, k) for k in range(4)]
    apart = [first(s, k) - second(s, k) for k in range(4)]
    return [
        *(_local_basis(nodes, 3, interval, s, k) for k in range(3)),
        _local_basis(nodes, 3, every, middle, 3),
        *(_local_basis(nodes, 2, interval, s, k) for k in range(2)),
        _local_basis(nodes, 2, every, middle, 2),
        np.concatenate(below, axis=1),
        np.concatenate(apart, axis=1),
        np.diff(s)[:, None],
        np.array([[problem.quadrotor.gravity, problem.quadrotor.rate_max]]),
    ]


def _spline(basis: Any, coefficients: Any, interval: NDArray[np.intp]) -> Any:
    return sum(basis[:, j] * coefficients[(interval + j).tolist()] for j in range(basis.shape[1]))


def _motion(checks: _Checks, data: list[Any], weight: Any, squared_speed: Any) -> tuple[Any, Any, Any]:
    """Return accelerations at the checks, jerks where rates are checked, and the times between checks."""
    every = np.arange(len(checks.nodes) - 1)
    at, own, gap = checks.point.tolist(), checks.owner.tolist(), checks.interval[:-1].tolist()
    p = [_spline(data[k], weight, checks.interval) for k in range(3)]
    p3 = _spline(data[3], weight, every)[own]
    b, b1 = (_spline(data[4 + k], squared_speed, checks.interval) for k in range(2))
    b2 = _spline(data[6], squared_speed, every)
    below, apart, widths = data[7:10]

    def path(order: int, axis: int) -> Any:
        terms = (math.comb(order, k) * p[k] * apart[:, 2 * (order - k) + axis] for k in range(min(order, 2) + 1))
        return sum(terms, below[:, 2 * order + axis])

    # Eq. (9) and its derivative; p''' only enters the jerk, on the side of its interval.
    acceleration = [path(2, i) * b + path(1, i) * b1 / 2 for i in (0, 1)]
    jerk = [
        ca.sqrt(b[at])
        * (
            (path(3, i)[at] + p3 * apart[at, i]) * b[at]
            + 1.5 * path(2, i)[at] * b1[at]
            + 0.5 * path(1, i)[at] * b2[own]
        )
        for i in (0, 1)
    ]
    speeds = ca.sqrt(b[:-1]) + ca.sqrt(b[1:])
    square = b2[gap] / 2 * (widths / speeds) ** 2
    # Eq. (7), in closed form because b is quadratic between checks.
    return acceleration, jerk, 2 * widths / speeds * _artanhc(square)


def _artanhc(square: Any) -> Any:
    """Return artanh(r)/r, r^2 = square < 1, by Gauss' continued fraction: smooth at 0, and never negative."""
    value: Any = 11.0
    for k in (5, 4, 3, 2, 1):
        value = 2 * k - 1 - k**2 * square / value
    return 1 / value


@lru_cache(maxsize=16)
def _program(intervals: int, certified: bool) -> Callable[..., Any]:
    """Build eq. (10) for one number of intervals; grid, paths and vehicle are its parameters."""
    checks = _place_checks(np.linspace(0.0, 1.0, intervals + 1), certified)
    count = len(checks.s)
    sizes = (intervals + 3, intervals + 2, count, count)
    weight, squared_speed, tilt, thrust = unknowns = [ca.SX.sym(f"x{i}", n) for i, n in enumerate(sizes)]
    shapes = ((count, 4),) * 3 + ((intervals, 4),) + ((count, 3),) * 2 + ((intervals, 3),)
    shapes += ((count, 8),) * 2 + ((count - 1, 1), (1, 2))
    data = [ca.SX.sym(f"d{i}", *shape) for i, shape in enumerate(shapes)]
    gravity, rate_max = data[-1][0], data[-1][1]
    acceleration, jerk, elapsed = _motion(checks, data, weight, squared_speed)
    sin, cos, at = ca.sin(tilt), ca.cos(tilt), checks.point.tolist()
    turned = tilt[1:] - tilt[:-1]
    constraints = [
        (acceleration[0] - thrust * sin) / 10,
        (acceleration[1] + gravity - thrust * cos) / 10,
        (jerk[0] * cos[at] - jerk[1] * sin[at]) / thrust[at] / 10,
    ]
    if certified:
        constraints += [turned / rate_max - elapsed, -turned / rate_max - elapsed]
    program = {
        "x": ca.vertcat(*unknowns),
        "p": ca.vertcat(*(ca.vec(d) for d in data)),
        "f": ca.sum1(elapsed),
        "g": ca.vertcat(*constraints),
    }
    solver: Callable[..., Any] = ca.nlpsol("eq10", "ipopt", program, OPTIONS)
    return solver


def _bounds(problem: _Problem, checks: _Checks, margins: Array) -> dict[str, Array]:
    """Return the bounds of the program; margins narrow each interval's limits, shape (3, N)."""
    vehicle, count, intervals = problem.quadrotor, len(checks.s), len(checks.nodes) - 1
    low, high = np.zeros(intervals + 3), np.ones(intervals + 3)
    # Two equal coefficients at an end fix p and p' = 0 there, the rest of section II-E.
    low[:2] = high[:2] = problem.ends[0]
    low[-2:] = high[-2:] = problem.ends[1]
    upright = np.where(np.isin(np.arange(count), (0, count - 1)), 0.0, np.inf)
    at_checks = np.zeros((3, count))
    np.maximum.at(at_checks, (slice(None), checks.point), margins[:, checks.owner])
    rate = (vehicle.rate_max - margins[2, checks.owner]) / 10
    turns = np.zeros(2 * (count - 1) if problem.certified else 0)
    tied = np.zeros(2 * count)
    return {
        "lbx": np.concatenate([low, np.full(intervals + 2, 1e-4), -upright, vehicle.thrust_min + at_checks[1]]),
        "ubx": np.concatenate([high, np.full(intervals + 2, np.inf), upright, vehicle.thrust_max - at_checks[0]]),
        "lbg": np.concatenate([tied, -rate, turns - np.inf]),
        "ubg": np.concatenate([tied, rate, turns]),
    }


def _solve(problem: _Problem, start: _Iterate, margins: Array) -> _Iterate:
    checks, intervals = start.checks, len(start.checks.nodes) - 1
    solver = _program(intervals, problem.certified)
    parameters = np.concatenate([d.ravel(order="F") for d in _data(problem, checks)])
    guess = np.concatenate([start.weight, start.squared_speed, start.tilt, start.thrust])
    found = np.asarray(solver(x0=guess, p=parameters, **_bounds(problem, checks, margins))["x"]).ravel()
    stats = solver.stats()  # type: ignore[attr-defined]
    problem.log.append(int(stats["iter_count"]))
    parts = np.split(found, np.cumsum([intervals + 3, intervals + 2, len(checks.s)]))
    return _Iterate(checks, *parts, outcome=str(stats["return_status"]))


def _slow_start(problem: _Problem, intervals: int) -> _Iterate:
    """Return section II-E's start: from end weight to end weight, centrally, upright and slowly."""
    nodes = np.linspace(0.0, 1.0, intervals + 1)
    checks = _place_checks(nodes, problem.certified)
    knots = _knots(nodes, 3)
    share = (knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3
    share = share**3 * (10 - 15 * share + 6 * share**2)
    weight = problem.ends[0] + (problem.ends[1] - problem.ends[0]) * share
    count = len(checks.s)
    hover = np.full(count, problem.quadrotor.gravity)
    return _Iterate(checks, weight, np.full(intervals + 2, SLOW), np.zeros(count), hover)


def _trajectory(problem: _Problem, iterate: _Iterate) -> FlatTrajectory:
    nodes = iterate.checks.nodes

    def powers(coefficients: Array, degree: int) -> Array:
        spline = BSpline(_knots(nodes, degree), coefficients, degree)
        return np.array([spline(nodes[:-1], nu=k) / math.factorial(k) for k in range(degree + 1)])

    weight, squared_speed = powers(iterate.weight, 3), powers(iterate.squared_speed, 2)
    return FlatTrajectory(nodes, weight, squared_speed, problem.outer_paths, problem.quadrotor)


def _refined(problem: _Problem, iterate: _Iterate, intervals: int) -> _Iterate:
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
        values = BSpline(_knots(nodes, degree), coefficients, degree)(dense)
        return np.asarray(make_lsq_spline(dense, values, _knots(finer, degree), degree).c)

    weight, squared_speed = insert(iterate.weight, 3), insert(iterate.squared_speed, 2)
    checks = _place_checks(finer, problem.certified)
    draft = _Iterate(checks, np.clip(weight, 0, 1), np.maximum(squared_speed, 1e-4), checks.s, checks.s)
    tilt = np.interp(checks.s, iterate.checks.s, iterate.tilt)
    return replace(draft, tilt=tilt, thrust=np.interp(checks.s, iterate.checks.s, iterate.thrust))


def _certify(problem: _Problem, iterate: _Iterate) -> _Iterate:
    """Narrow the limits of each interval by what was exceeded within it, until nothing is."""
    vehicle = problem.quadrotor
    margins = np.zeros((3, len(iterate.checks.nodes) - 1))
    most = 0.4 * np.array([[vehicle.thrust_max - vehicle.thrust_min]] * 2 + [[vehicle.rate_max]])
    for _ in range(NARROWINGS):
        flight = _trajectory(problem, iterate)
        if iterate.outcome != SUCCESS or flight.violation() <= ALLOWED_VIOLATION:
            break
        excess = flight.excess()
        margins = np.minimum(margins + np.where(excess > 0, GAIN * excess + LEAST, 0.0), most)
        iterate = _solve(problem, iterate, margins)
    return iterate


def _ladder(intervals: int) -> list[int]:
    """Return the numbers of intervals of the successive grids, e.g. 40, 63, 100."""
    sizes = [intervals]
    while sizes[0] > COARSEST:
        sizes.insert(0, math.ceil(sizes[0] / GROWTH))
    return sizes


def plan(
    outer_paths: OuterPaths,
    quadrotor: Quadrotor = DEFAULT_QUADROTOR,
    *,
    ends: tuple[float, float] = (0.5, 0.5),
    intervals: int = 100,
    checks: str = "certified",
) -> FlatSolution:
    """Return the fastest flight between two outer paths, from rest to rest and upright at both ends.

    Args:
        outer_paths: two paths answering `path(s, order)`, three times differentiable, at rest (y' = 0)
            at s = 0 and 1; `optimal.paths` has the paper's.
        quadrotor: the vehicle and its limits.
        ends: the weights p_1(0), p_1(1) of the first path where the flight begins and ends.
        intervals: pieces of p and b.
        checks: "certified": limits hold in continuous time, to 1e-6 relative; "nodes": as published,
            at grid nodes only, with what happens in between as the solution's violation.

    Returns:
        The solution; where the solve fails its time is inf and its status says why.

    Raises:
        ValueError: for arguments that describe no problem.

    Source: eq. (10), started as section II-E proposes.
    """
    _require_valid(outer_paths, ends, intervals, checks)
    begun = time.perf_counter()
    problem = _Problem(outer_paths, quadrotor, ends, checks == "certified")
    sizes = _ladder(intervals) if problem.certified else [intervals]
    iterate = _slow_start(problem, sizes[0])
    for size in sizes:
        if size != sizes[0]:
            iterate = _refined(problem, iterate, size)
        iterate = _solve(problem, iterate, np.zeros((3, size)))
        if iterate.outcome != SUCCESS:
            break
    if problem.certified:
        iterate = _certify(problem, iterate)
    return _judged(problem, iterate, time.perf_counter() - begun)


def _judged(problem: _Problem, iterate: _Iterate, solve_time: float) -> FlatSolution:
    """Return a time only for what may be called a solution, else the reason why not."""
    iterations, size = sum(problem.log), len(iterate.checks.nodes) - 1
    flight = _trajectory(problem, iterate)
    violation = flight.violation() if iterate.outcome == SUCCESS else math.inf
    if iterate.outcome != SUCCESS:
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
        status = "Solved: limits hold in continuous time."
        return FlatSolution(flight.duration, status, True, iterations, solve_time, flight, violation)
    return FlatSolution(math.inf, status, False, iterations, solve_time, None, math.inf)


def _require_valid(outer_paths: OuterPaths, ends: tuple[float, float], intervals: int, checks: str) -> None:
    if checks not in ("certified", "nodes"):
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
