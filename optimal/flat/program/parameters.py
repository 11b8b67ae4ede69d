"""The numbers of the program: parameters from grid and outer paths, and bounds of unknowns and constraints."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from flatgym.quadrotor import Array
from optimal.flat.problem import Iterate, PlanningProblem, TrustRegion, check_points, shared_points, spaces
from optimal.flat.program.transcription import QUADRATURE, check_functions

LEAST_SQUARED_SPEED = 1e-3
"""The lower bound of b [speed_unit]."""
ROUNDING = 1e-12
"""Derivatives of outer paths below this, relative to the greatest of their order, count as rounding."""


@lru_cache(maxsize=4)
def parameters(problem: PlanningProblem, grid: tuple[float, ...]) -> Array:
    """Return the parameters of the program, in its order.

    Args:
        problem: the problem, for its system, outer paths and unit of b.
        grid: the nodes.
    """
    system, nodes = problem.system, np.array(grid)
    weight_space, speed_space = spaces(system, nodes, problem.certified)
    points = check_points(nodes, problem.certified)
    s, owner = points.ravel(), np.repeat(np.arange(len(nodes) - 1), points.shape[1])
    orders = range(system.order + 1)
    last = [problem.outer_paths[-1](s, o) for o in orders]
    apart = [[path(s, o) - last[o] for o in orders] for path in problem.outer_paths[:-1]]
    bases = [weight_space.basis(owner, s, j) for j in orders]
    # linear[check, order, output, coefficient, path] of the sum in the docstring of `transcription`.
    linear = np.zeros((len(s), len(orders), len(system.outputs), weight_space.degree + 1, len(apart)))
    for i, difference in enumerate(apart):
        for o in orders:
            for j in range(o + 1):
                linear[:, o, :, :, i] += math.comb(o, j) * difference[o - j][:, :, None] * bases[j][:, None, :]
    linear, offset = _without_rounding(linear), _without_rounding(np.stack(last, axis=1))
    basis = problem.speed_unit * np.stack([speed_space.basis(owner, s, k) for k in range(system.order)], axis=1)
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


def _without_rounding(values: Array) -> Array:
    """Return derivatives of paths with those that are 0 but for rounding set to 0.

    An equation at rest that holds for any unknowns then has residual and gradient 0. With 1e-12 in place of 0 it would
    demand large changes of the unknowns.

    Args:
        values: shape (checks, orders, outputs, ...).
    """
    scale = np.abs(values).max(axis=tuple({*range(values.ndim)} - {1, 2}), keepdims=True, initial=0.0)
    return np.where(np.abs(values) <= ROUNDING * scale, 0.0, values)


def program_bounds(problem: PlanningProblem, start: Iterate, margins: Array) -> dict[str, Any]:
    """Return the bounds of unknowns and constraints, under CasADi's names.

    Args:
        problem: the problem.
        start: the initial point, for its grid and the whole turns of its angles at the end.
        margins: tightening of the limits on each interval, see `optimal.flat.program.solver.solve_program`.
    """
    system, lift, paths = problem.system, problem.system.lift(), len(problem.outer_paths)
    nodes = start.nodes
    weight_space, speed_space = spaces(system, nodes, problem.certified)
    points = check_points(nodes, problem.certified)
    shared, fixed = len(shared_points(nodes, problem.certified)), problem.level + 1
    low, high = np.zeros((weight_space.size, paths - 1)), np.ones((weight_space.size, paths - 1))
    # level + 1 equal coefficients at an end fix p there and set `level` of its derivatives to zero.
    low[:fixed] = high[:fixed] = problem.ends[0, :-1]
    low[-fixed:] = high[-fixed:] = problem.ends[1, :-1]
    lifted_low, lifted_high = np.tile(lift.low, (shared, 1)), np.tile(lift.high, (shared, 1))
    rest = ~np.isnan(np.array(lift.rest, dtype=np.float64))
    upright = np.array(lift.rest)[rest]
    turns = np.rint((start.lifted[-1, rest] - upright) / (2 * math.pi))
    lifted_low[0, rest] = lifted_high[0, rest] = upright
    lifted_low[-1, rest] = lifted_high[-1, rest] = upright + 2 * math.pi * turns
    _, scale, least, greatest = system.bounds
    per_check = np.repeat(margins.transpose(2, 0, 1), points.shape[1], axis=0)
    if not problem.certified:
        per_check = np.zeros((shared, *margins.shape[:2]))
    own, bounded = len(lift.limited), list(lift.limited)
    at_shared = _at_shared(per_check[:, :, :own], points.shape[1]) if problem.certified else per_check[:, :, :own]
    lifted_low[:, bounded] = scale[:own] * (least[:own] + at_shared[:, 1])
    lifted_high[:, bounded] = scale[:own] * (greatest[:own] - at_shared[:, 0])
    sums = [weight_space.size] if paths > 2 else []
    coupling = np.zeros(shared * check_functions(system, paths, problem.certified)[0].size1_out(0))
    turning_size = check_functions(system, paths, True)[2].size1_out(0)
    turns = np.ones((shared - 1) * turning_size if problem.certified else 0)
    speeds = speed_space.size
    return {
        "lbx": np.concatenate([low.ravel(), np.full(speeds, LEAST_SQUARED_SPEED), lifted_low.ravel()]),
        "ubx": np.concatenate([high.ravel(), np.full(speeds, np.inf), lifted_high.ravel()]),
        "lbg": np.concatenate([np.zeros(sum(sums)), coupling, (least + per_check[:, 1])[:, own:].ravel(), -turns]),
        "ubg": np.concatenate([np.ones(sum(sums)), coupling, (greatest - per_check[:, 0])[:, own:].ravel(), turns]),
    }


def _at_shared(per_check: Array, per: int) -> Array:
    """Return values at the checks of all intervals, with the greater of both where two intervals share a check.

    Args:
        per_check: shape (intervals * per, ...).
        per: checks of an interval.
    """
    last = np.arange(per - 1, len(per_check), per)
    once = np.delete(per_check, last[:-1], axis=0)
    once[per - 1 : -1 : per - 1] = np.maximum(per_check[last[:-1]], per_check[last[:-1] + 1])
    return once


def apply_trust_region(
    bounds: dict[str, Any], guess: Array, problem: PlanningProblem, start: Iterate, trust_region: TrustRegion
) -> None:
    """Intersect the bounds of the unknowns with the trust region around the start, in place.

    Unknowns fixed by their bounds stay fixed.
    """
    lift = problem.system.lift()
    free = np.isinf(np.array(lift.low)) & np.isinf(np.array(lift.high))
    lifted = np.broadcast_to(np.where(free, trust_region.attitude, np.inf), start.lifted.shape)
    speeds = start.squared_speed * trust_region.speed
    distance = np.concatenate([np.full(start.weights.size, trust_region.weights), speeds, lifted.ravel()])
    low, high = bounds["lbx"], bounds["ubx"]
    bounds["lbx"] = np.clip(guess - distance, low, high)
    bounds["ubx"] = np.clip(guess + distance, low, high)
