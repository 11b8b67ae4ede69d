"""Eq. (10) of the paper as a nonlinear program: its unknowns, its checks, its bounds.

The unknowns are the spline coefficients (`optimal.flat.splines`) of k - 1 weights p_i (the last is what is
missing to 1) and of the squared speed b, and at every check what the system lifts out of the jet
(`optimal.systems`: tilt and thrust, for the planar quadrotor). With k = 1 the path is fixed, and this
is eq. (8). The path is linear in the weights' coefficients,

    y^(o)(s) = y_k^(o) + sum_i sum_j C(o, j) p_i^(j) (y_i - y_k)^(o - j),

so that grid, outer paths and end points enter as numbers, and one program of each number of
intervals serves them all. Building it costs more than solving it. Programs are shared within a
process and not safe to run from several threads; use processes.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from flatgym.quadrotor import Array
from optimal.flat.problem import (
    FREE,
    Iterate,
    Problem,
    TrustRegion,
    check_points,
    checks_per_interval,
    local_sizes,
    shared_points,
    spaces,
)
from optimal.flat.splines import SplineSpace
from optimal.systems import FlatSystem, along_path

SLOWEST = 1e-3
"""The least b allowed [1/s^2]."""
QUADRATURE = np.polynomial.legendre.leggauss(3)
SUCCESS = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
"""Outcomes of Ipopt that count as converged."""
USABLE = (*SUCCESS, "Maximum_Iterations_Exceeded", "Search_Direction_Becomes_Too_Small")
"""Outcomes of Ipopt worth going on with: what is called solved is measured afterwards."""
IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "max_iter": 200,
    "tol": 1e-6,
    # A small barrier from the beginning: the slow start is well inside, and a solution is kept nearly as it is.
    "mu_init": 4e-5,
    "warm_start_init_point": "yes",
    **{f"warm_start_{name}": 1e-5 for name in ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")},
    "warm_start_mult_bound_push": 1e-5,
}
OPTIONS: dict[str, Any] = {
    "print_time": False,
    "ipopt": IPOPT,
    "calc_lam_p": False,
    "no_nlp_grad": True,
    "expand": True,
}


@lru_cache(maxsize=16)
def _check(system: FlatSystem, paths: int, certified: bool) -> tuple[Any, Any, Any]:
    """Return functions of one check: ties, limited quantities, and turning times between two."""
    order, outputs, lift = system.order, len(system.outputs), system.lift()
    weight_size, speed_size = local_sizes(system, certified)
    coefficients = ca.SX.sym("c", (paths - 1) * weight_size)
    speeds = ca.SX.sym("d", speed_size)
    lifted, after = ca.SX.sym("l", len(lift.names)), ca.SX.sym("m", len(lift.names))
    offset = ca.SX.sym("y", outputs, order + 1)
    linear = ca.SX.sym("M", outputs * (order + 1), (paths - 1) * weight_size)
    speed_basis = ca.SX.sym("B", order, speed_size)
    path = ca.reshape(linear @ coefficients, outputs, order + 1) + offset
    b = speed_basis @ speeds
    jet = along_path(ca.horzsplit(path), ca.vertsplit(b))
    inputs = [coefficients, speeds, lifted, linear, offset, speed_basis]
    return (
        ca.Function("ties", inputs, [lift.ties(jet[:-1], lifted)]),
        ca.Function("limited", inputs, [lift.limited(jet, lifted)]),
        ca.Function("turning", [lifted, after, speeds, speed_basis], [lift.turning_time(lifted, after), b[0]]),
    )


@lru_cache(maxsize=32)
def _program(system: FlatSystem, paths: int, intervals: int, certified: bool) -> Any:
    """Build eq. (10) for one system, number of paths and number of intervals; all else are parameters."""
    grid = np.linspace(0.0, 1.0, intervals + 1)
    weight_space, speed_space = spaces(system, grid, certified)
    lift, per, order, outputs = system.lift(), checks_per_interval(certified), system.order, len(system.outputs)
    weight_size, speed_size = local_sizes(system, certified)
    free, count = (paths - 1) * weight_size, per * intervals
    shared = intervals * (per - 1) + 1
    weights = ca.MX.sym("weights", paths - 1, weight_space.size)
    speeds = ca.MX.sym("b", speed_space.size)
    lifted = ca.MX.sym("lifted", len(lift.names), shared)
    linear = ca.MX.sym("linear", outputs * (order + 1), free * count)
    offset = ca.MX.sym("offset", outputs, (order + 1) * count)
    basis = ca.MX.sym("basis", order, speed_size * count)
    times = ca.MX.sym("times", intervals, len(QUADRATURE[0]) * speed_size)
    widths = ca.MX.sym("widths", intervals)

    owner = np.repeat(np.arange(intervals), per)
    of_check = (owner * (per - 1) + np.tile(np.arange(per), intervals)).tolist()
    local_weights = ca.reshape(weights[:, weight_space.local(owner).ravel().tolist()], free, count)
    local_speeds = ca.reshape(speeds[speed_space.local(owner).ravel().tolist()], speed_size, count)
    ties, limited, turning = _check(system, paths, certified)
    arguments = [local_weights, local_speeds, lifted[:, of_check], linear, offset, basis]
    constraints = [ca.sum1(weights).T] if paths > 2 else []
    # A tie at a node is the same from both sides and stands once.
    once = [i for i in range(count) if i % per < per - 1 or i == count - 1]
    shared_arguments = [_columns(part, once, count) for part in arguments]
    constraints.append(ca.vec(ties.map(len(once))(*shared_arguments)))
    # As published, a node is checked with the control of the interval that begins there, and no other.
    checked, times_checked = (arguments, count) if certified else (shared_arguments, len(once))
    constraints.append(ca.vec(limited.map(times_checked)(*checked)))
    slowness = _slowness(speeds, speed_space, times, intervals)
    if certified:
        constraints.append(_turning(turning, lifted, local_speeds, basis, widths, intervals, per))
    problem = {
        "x": ca.vertcat(ca.vec(weights), speeds, ca.vec(lifted)),
        "p": ca.vertcat(*(ca.vec(part) for part in (linear, offset, basis, times, widths))),
        "f": ca.dot(widths, slowness),
        "g": ca.vertcat(*constraints),
    }
    return ca.nlpsol("eq10", "ipopt", problem, OPTIONS)


def _columns(matrix: Any, chosen: list[int], count: int) -> Any:
    """Return the chosen of `count` equal blocks of columns."""
    width = matrix.shape[1] // count
    return matrix[:, [width * i + j for i in chosen for j in range(width)]]


def _slowness(speeds: Any, space: SplineSpace, times: Any, intervals: int) -> Any:
    """Return the mean of 1/sqrt(b) over each interval, by Gauss-Legendre quadrature."""
    local = ca.reshape(speeds[space.local(np.arange(intervals)).ravel().tolist()], space.degree + 1, intervals).T
    weights, width = QUADRATURE[1] / 2, space.degree + 1
    parts = [ca.sum2(times[:, width * i : width * (i + 1)] * local) for i in range(len(weights))]
    return sum(w / ca.sqrt(b) for w, b in zip(weights, parts, strict=True))


def _turning(turning: Any, lifted: Any, speeds: Any, basis: Any, widths: Any, intervals: int, per: int) -> Any:
    """Return least times between neighbouring checks minus the times that pass."""
    count, begin = per * intervals, [i for i in range(per * intervals) if i % per < per - 1]
    end = [i + 1 for i in begin]
    every = lifted.shape[1]
    least, b = turning.map(len(begin))(
        lifted[:, : every - 1], lifted[:, 1:], _columns(speeds, begin, count), _columns(basis, begin, count)
    )
    _, after = turning.map(len(end))(
        lifted[:, : every - 1], lifted[:, 1:], _columns(speeds, end, count), _columns(basis, end, count)
    )
    gap = ca.reshape(ca.repmat(widths.T / (per - 1), per - 1, 1), 1, len(begin))
    passed = 2 * gap / (ca.sqrt(b) + ca.sqrt(after))
    return ca.vec(least - ca.repmat(passed, least.shape[0], 1))


@lru_cache(maxsize=4)
def _parameters(problem: Problem, grid: tuple[float, ...]) -> Array:
    """Return what the program needs to know of grid and paths, in its order."""
    system, nodes = problem.system, np.array(grid)
    weight_space, speed_space = spaces(system, nodes, problem.certified)
    points = check_points(nodes, problem.certified)
    s, owner = points.ravel(), np.repeat(np.arange(len(nodes) - 1), points.shape[1])
    orders = range(system.order + 1)
    last = [problem.outer_paths[-1](s, o) for o in orders]
    apart = [[path(s, o) - last[o] for o in orders] for path in problem.outer_paths[:-1]]
    bases = [weight_space.basis(owner, s, j) for j in orders]
    # linear[check, order, output, coefficient, path] of the sum in the module's docstring.
    linear = np.zeros((len(s), len(orders), len(system.outputs), weight_space.degree + 1, len(apart)))
    for i, difference in enumerate(apart):
        for o in orders:
            for j in range(o + 1):
                linear[:, o, :, :, i] += math.comb(o, j) * difference[o - j][:, :, None] * bases[j][:, None, :]
    offset = np.stack(last, axis=1)
    basis = np.stack([speed_space.basis(owner, s, k) for k in range(system.order)], axis=1)
    gauss = nodes[:-1, None] + np.diff(nodes)[:, None] * (QUADRATURE[0] + 1) / 2
    every = np.arange(len(nodes) - 1)
    times = np.concatenate([speed_space.basis(every, gauss[:, i], 0) for i in range(gauss.shape[1])], axis=1)
    return np.concatenate(
        [
            linear.reshape(len(s), len(orders) * len(system.outputs), -1).transpose(0, 2, 1).ravel(),
            offset.ravel(),
            basis.transpose(0, 2, 1).ravel(),
            times.ravel(order="F"),
            np.diff(nodes),
        ]
    )


def _bounds(problem: Problem, nodes: Array, margins: Array) -> dict[str, Any]:
    """Return the bounds of the program; margins narrow each interval's limits, shape (2, limits, N)."""
    system, lift, paths = problem.system, problem.system.lift(), len(problem.outer_paths)
    weight_space, speed_space = spaces(system, nodes, problem.certified)
    points = check_points(nodes, problem.certified)
    shared, fixed = len(shared_points(nodes, problem.certified)), problem.level + 1
    low, high = np.zeros((weight_space.size, paths - 1)), np.ones((weight_space.size, paths - 1))
    # Equal coefficients at an end fix p there, and that many of its derivatives at zero.
    low[:fixed] = high[:fixed] = problem.ends[0, :-1]
    low[-fixed:] = high[-fixed:] = problem.ends[1, :-1]
    lifted_low, lifted_high = np.tile(lift.low, (shared, 1)), np.tile(lift.high, (shared, 1))
    rest = ~np.isnan(np.array(lift.rest, dtype=np.float64))
    for side in (0, -1):
        lifted_low[side, rest] = lifted_high[side, rest] = np.array(lift.rest)[rest]
    _, _, least, greatest = system.bounds
    per_check = np.repeat(margins.transpose(2, 0, 1), points.shape[1], axis=0)
    if not problem.certified:
        per_check = np.zeros((shared, *margins.shape[:2]))
    sums = [weight_space.size] if paths > 2 else []
    ties = np.zeros(shared * _check(system, paths, problem.certified)[0].size1_out(0))
    turns = np.zeros((shared - 1) * _check(system, paths, True)[2].size1_out(0) if problem.certified else 0)
    return {
        "lbx": np.concatenate([low.ravel(), np.full(speed_space.size, SLOWEST), lifted_low.ravel()]),
        "ubx": np.concatenate([high.ravel(), np.full(speed_space.size, np.inf), lifted_high.ravel()]),
        "lbg": np.concatenate([np.zeros(sum(sums)), ties, (least + per_check[:, 1]).ravel(), turns - np.inf]),
        "ubg": np.concatenate([np.ones(sum(sums)), ties, (greatest - per_check[:, 0]).ravel(), turns]),
    }


def _apply_trust_region(
    bounds: dict[str, Any], guess: Array, problem: Problem, start: Iterate, reach: TrustRegion
) -> None:
    """Narrow the bounds of the unknowns to `reach` around the start, in place; pinned ones stay pinned."""
    lift = problem.system.lift()
    free = np.isinf(np.array(lift.low)) & np.isinf(np.array(lift.high))
    lifted = np.broadcast_to(np.where(free, reach.attitude, np.inf), start.lifted.shape)
    speeds = start.squared_speed * reach.speed
    distance = np.concatenate([np.full(start.weights.size, reach.weights), speeds, lifted.ravel()])
    low, high = bounds["lbx"], bounds["ubx"]
    bounds["lbx"] = np.clip(guess - distance, low, high)
    bounds["ubx"] = np.clip(guess + distance, low, high)


def solve_program(problem: Problem, start: Iterate, margins: Array | None = None, reach: TrustRegion = FREE) -> Iterate:
    """Return what Ipopt makes of a start, on the start's grid.

    Args:
        problem: what is to be solved.
        start: where to begin.
        margins: what to take off the greatest and add to the least values of each limit on every
            interval, relative to its scale, shape (2, limits, N); by default nothing.
        reach: how far from the start to look.

    Returns:
        The point where Ipopt stopped, with its outcome, which need not be in SUCCESS.
    """
    nodes, paths = start.nodes, len(problem.outer_paths)
    if margins is None:
        margins = np.zeros((2, len(problem.system.bounds[0]), len(nodes) - 1))
    solver = _program(problem.system, paths, len(nodes) - 1, problem.certified)
    guess = np.concatenate([start.weights.ravel(), start.squared_speed, start.lifted.ravel()])
    bounds = _bounds(problem, nodes, margins)
    _apply_trust_region(bounds, guess, problem, start, reach)
    if start.multipliers is not None:
        bounds |= zip(("lam_x0", "lam_g0"), start.multipliers, strict=True)
    found = solver(x0=guess, p=_parameters(problem, tuple(nodes.tolist())), **bounds)
    parts = np.split(np.array(found["x"]).ravel(), np.cumsum([start.weights.size, start.squared_speed.size]))
    stats = solver.stats()
    # Ipopt relaxes bounds by 1e-8; the corridor is kept exactly.
    return replace(
        start,
        weights=np.clip(parts[0].reshape(start.weights.shape), 0, 1),
        squared_speed=parts[1],
        lifted=parts[2].reshape(start.lifted.shape),
        multipliers=(found["lam_x"], found["lam_g"]),
        outcome=str(stats["return_status"]),
        iterations=start.iterations + int(stats["iter_count"]),
    )
