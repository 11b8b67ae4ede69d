"""Eq. (10) of the paper as a nonlinear program: its unknowns, its checks, its bounds.

On N intervals the controls p''' and b'' are constant, so p is a cubic and b a quadratic spline.
Their B-spline coefficients are the unknowns: continuity is then exact, and coefficients within
[0, 1] keep p there everywhere, not at nodes only. Tilt theta and thrust f stand as variables at
every check, tied to the path by

    x'' = f sin(theta),   z'' + g = f cos(theta),   rate = (x''' cos(theta) - z''' sin(theta)) / f,

which is the flat input of section II-A with its misprint corrected, and makes every limit a box.
It also makes the problem connected. Admissible thrust vectors fill a ring; between two checks the
vector could cut through its hole, turning by half a turn in no time. So between certified checks
the tilt may turn by no more than rate_max times the time that passes, which every flight obeys.

Building a program costs more than solving it, so there is one for each number of intervals, and
everything else is a parameter: the grid (through its basis), the outer paths, the vehicle. The
programs are shared within a process and not safe to run from several threads; use processes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from flatgym.quadrotor import Array, Quadrotor
from optimal.paths import OuterPaths

SLOWEST = 1e-4
"""The least b allowed [1/s^2]."""
SUCCESS = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
"""Outcomes of Ipopt that will do: what is called solved is measured afterwards."""
IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "max_iter": 400,
    "tol": 1e-8,
    "acceptable_constr_viol_tol": 1e-6,
    "mu_strategy": "adaptive",
}
OPTIONS: dict[str, Any] = {"print_time": False, "ipopt": IPOPT, "calc_lam_p": False, "no_nlp_grad": True}


@dataclass(frozen=True, eq=False)
class Checks:
    """Where limits are checked: states at `s`, in `interval`; rates at check `point` of interval `owner`.

    Third derivatives jump at nodes, so a node between two certified intervals has two rates.
    """

    nodes: Array
    s: Array
    interval: NDArray[np.intp]
    point: NDArray[np.intp]
    owner: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Iterate:
    """A point of the program on its grid: coefficients of p and b, tilt and thrust at the checks."""

    checks: Checks
    weight: Array
    squared_speed: Array
    tilt: Array
    thrust: Array
    outcome: str = "not solved yet"
    iterations: int = 0


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be solved, on whatever grid."""

    outer_paths: OuterPaths
    quadrotor: Quadrotor
    ends: tuple[float, float]
    certified: bool


def place_checks(nodes: Array, certified: bool) -> Checks:
    """Place three checks per interval, at both ends and the middle; uncertified, one at every node."""
    count = len(nodes) - 1
    per = 2 if certified else 1
    index = np.arange(per * count + 1)
    interval = np.minimum(index // per, count - 1)
    s = np.interp(index / per, np.arange(count + 1), nodes)
    if not certified:
        return Checks(nodes, s, interval, index, interval)
    owner = np.repeat(np.arange(count), 3)
    return Checks(nodes, s, interval, 2 * owner + np.tile([0, 1, 2], count), owner)


def knots(nodes: Array, degree: int) -> Array:
    """Return the knots of a spline of that degree with all but its highest derivative continuous."""
    return np.concatenate([[nodes[0]] * degree, nodes, [nodes[-1]] * degree])


def _local_basis(nodes: Array, degree: int, interval: NDArray[np.intp], s: Array, order: int) -> Array:
    """Return derivatives of the degree + 1 B-splines that live on each interval, shape (len(s), degree + 1)."""
    splines = BSpline(knots(nodes, degree), np.eye(len(nodes) + degree - 1), degree)
    return np.asarray(splines(s, nu=order)[np.arange(len(s))[:, None], interval[:, None] + np.arange(degree + 1)])


def _data(problem: Problem, checks: Checks) -> list[Array]:
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


def _motion(checks: Checks, data: list[Any], weight: Any, squared_speed: Any) -> tuple[Any, Any, Any]:
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
def _program(intervals: int, certified: bool) -> Any:
    """Build eq. (10) for one number of intervals; grid, paths and vehicle are its parameters."""
    checks = place_checks(np.linspace(0.0, 1.0, intervals + 1), certified)
    count = len(checks.s)
    sizes = (intervals + 3, intervals + 2, count, count)
    weight, squared_speed, tilt, thrust = unknowns = [ca.SX.sym(f"x{i}", n) for i, n in enumerate(sizes)]
    shapes = [(count, 4)] * 3 + [(intervals, 4)] + [(count, 3)] * 2 + [(intervals, 3)]
    shapes += [(count, 8)] * 2 + [(count - 1, 1), (1, 2)]
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
    program: dict[str, Any] = {
        "x": ca.vertcat(*unknowns),
        "p": ca.vertcat(*(ca.vec(d) for d in data)),
        "f": ca.sum1(elapsed),
        "g": ca.vertcat(*constraints),
    }
    solver: Any = ca.nlpsol("eq10", "ipopt", program, OPTIONS)
    return solver


def _bounds(problem: Problem, checks: Checks, margins: Array) -> dict[str, Array]:
    """Return the bounds of the program; margins narrow each interval's limits, shape (3, N)."""
    vehicle, count, intervals = problem.quadrotor, len(checks.s), len(checks.nodes) - 1
    low, high = np.zeros(intervals + 3), np.ones(intervals + 3)
    # Two equal coefficients at an end fix p and p' = 0 there, the rest of section II-E.
    low[:2] = high[:2] = problem.ends[0]
    low[-2:] = high[-2:] = problem.ends[1]
    upright = np.where(np.isin(np.arange(count), (0, count - 1)), 0.0, np.inf)
    # A check at a node belongs to both its intervals and takes the wider margin.
    above, below = np.zeros(count), np.zeros(count)
    np.maximum.at(above, checks.point, margins[0, checks.owner])
    np.maximum.at(below, checks.point, margins[1, checks.owner])
    rate = (vehicle.rate_max - margins[2, checks.owner]) / 10
    turns = np.zeros(2 * (count - 1) if problem.certified else 0)
    tied = np.zeros(2 * count)
    return {
        "lbx": np.concatenate([low, np.full(intervals + 2, SLOWEST), -upright, vehicle.thrust_min + below]),
        "ubx": np.concatenate([high, np.full(intervals + 2, np.inf), upright, vehicle.thrust_max - above]),
        "lbg": np.concatenate([tied, -rate, turns - np.inf]),
        "ubg": np.concatenate([tied, rate, turns]),
    }


def solve_program(problem: Problem, start: Iterate, margins: Array | None = None) -> Iterate:
    """Return what Ipopt makes of a start, on the start's grid.

    Args:
        problem: what is to be solved.
        start: where to begin.
        margins: what to take off thrust_max, thrust_min [m/s^2] and rate_max [rad/s] on every
            interval, shape (3, N); by default nothing.

    Returns:
        The point where Ipopt stopped, with its outcome, which need not be in SUCCESS.
    """
    checks, intervals = start.checks, len(start.checks.nodes) - 1
    margins = np.zeros((3, intervals)) if margins is None else margins
    solver = _program(intervals, problem.certified)
    parameters = np.concatenate([d.ravel(order="F") for d in _data(problem, checks)])
    guess = np.concatenate([start.weight, start.squared_speed, start.tilt, start.thrust])
    found = np.asarray(solver(x0=guess, p=parameters, **_bounds(problem, checks, margins))["x"]).ravel()
    stats = solver.stats()
    iterations = start.iterations + int(stats["iter_count"])
    weight, squared_speed, tilt, thrust = np.split(found, np.cumsum([intervals + 3, intervals + 2, len(checks.s)]))
    # Ipopt relaxes bounds by 1e-8; the corridor is kept exactly.
    weight, outcome = np.clip(weight, 0, 1), str(stats["return_status"])
    return Iterate(checks, weight, squared_speed, tilt, thrust, outcome, iterations)
