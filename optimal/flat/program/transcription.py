"""Eq. (10) of the paper as a parametric nonlinear program.

The unknowns are the spline coefficients (`optimal.flat.splines`) of k - 1 weights p_i and of the squared
speed b, and at every check the unknowns that the system lifts out of the jet (`optimal.systems`: tilt and
thrust, for the planar quadrotor). The last weight is 1 minus the sum of the others. With k = 1 the path is
fixed, and the program is eq. (8). The path is linear in the coefficients of the weights,

    y^(o)(s) = y_k^(o) + sum_i sum_j C(o, j) p_i^(j) (y_i - y_k)^(o - j).

Grid, outer paths and end points are therefore numerical parameters (`optimal.flat.program.parameters`), and one
program serves all problems with the same system, number of paths and number of intervals. Building a program
costs more than solving it. Programs are cached within a process. They are not thread-safe; use processes.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from optimal.flat.problem import checks_per_interval, local_sizes, spaces
from optimal.flat.splines import SplineSpace
from optimal.systems import FlatSystem, along_path

QUADRATURE = np.polynomial.legendre.leggauss(3)
"""Gauss-Legendre nodes and weights of the flight time on an interval."""
IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "max_iter": 200,
    "tol": 1e-6,
    # The slow start is well inside the limits, and a warm start must stay close to its solution: a small first barrier.
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
def check_functions(system: FlatSystem, paths: int, certified: bool) -> tuple[Any, Any, Any]:
    """Return CasADi functions of one check: coupling residuals, limited quantities, and turning times."""
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
        ca.Function("coupling", inputs, [lift.coupling(jet[:-1], lifted)]),
        ca.Function("limited", inputs, [lift.limited_quantities(jet, lifted)]),
        ca.Function("turning", [lifted, after, speeds, speed_basis], [lift.turning_time(lifted, after), b[0]]),
    )


@lru_cache(maxsize=32)
def parametric_program(system: FlatSystem, paths: int, intervals: int, certified: bool) -> Any:
    """Return the solver of eq. (10) for one system, number of paths and number of intervals."""
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
    functions = check_functions(system, paths, certified)
    arguments = [local_weights, local_speeds, lifted[:, of_check], linear, offset, basis]
    constraints = [ca.sum1(weights).T] if paths > 2 else []
    constraints += _check_constraints(functions, arguments, per, certified)
    if certified:
        constraints.append(_turning(functions[2], lifted, local_speeds, basis, widths, intervals, per))
    problem = {
        "x": ca.vertcat(ca.vec(weights), speeds, ca.vec(lifted)),
        "p": ca.vertcat(*(ca.vec(part) for part in (linear, offset, basis, times, widths))),
        "f": ca.dot(widths, _mean_slowness(speeds, speed_space, times, intervals)),
        "g": ca.vertcat(*constraints),
    }
    return ca.nlpsol("eq10", "ipopt", problem, OPTIONS)


def _check_constraints(functions: tuple[Any, Any, Any], arguments: list[Any], per: int, certified: bool) -> list[Any]:
    """Return the coupling residuals and the limited quantities at the checks.

    Args:
        functions: of `check_functions`.
        arguments: their arguments for all checks of all intervals, one block of columns for each check.
        per: checks of an interval.
        certified: whether both intervals that meet at a node impose the limits there.
    """
    coupling, limited, _ = functions
    count = arguments[0].shape[1]
    # The coupling residual at a node is the same from both sides, and is imposed once.
    once = [i for i in range(count) if i % per < per - 1 or i == count - 1]
    shared_arguments = [_columns(part, once, count) for part in arguments]
    # The published scheme checks a node with the control of the interval that begins there only.
    checked, checks = (arguments, count) if certified else (shared_arguments, len(once))
    return [ca.vec(coupling.map(len(once))(*shared_arguments)), ca.vec(limited.map(checks)(*checked))]


def _columns(matrix: Any, chosen: list[int], count: int) -> Any:
    """Return the chosen blocks of a matrix whose columns form `count` equal blocks."""
    width = matrix.shape[1] // count
    return matrix[:, [width * i + j for i in chosen for j in range(width)]]


def _mean_slowness(speeds: Any, space: SplineSpace, times: Any, intervals: int) -> Any:
    """Return the mean of 1/sqrt(b) over each interval, by Gauss-Legendre quadrature."""
    local = ca.reshape(speeds[space.local(np.arange(intervals)).ravel().tolist()], space.degree + 1, intervals).T
    weights, width = QUADRATURE[1] / 2, space.degree + 1
    parts = [ca.sum2(times[:, width * i : width * (i + 1)] * local) for i in range(len(weights))]
    return sum(w / ca.sqrt(b) for w, b in zip(weights, parts, strict=True))


def _turning(turning: Any, lifted: Any, speeds: Any, basis: Any, widths: Any, intervals: int, per: int) -> Any:
    """Return the least turning times between neighbouring checks, divided by the elapsed times."""
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
    elapsed = 2 * gap / (ca.sqrt(b) + ca.sqrt(after))
    return ca.vec(least / ca.repmat(elapsed, least.shape[0], 1))
