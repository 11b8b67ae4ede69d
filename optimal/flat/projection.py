"""A flight as the start of eq. (10): its projection onto a corridor.

A point of the flight is a combination of the outer paths at one path coordinate. For each s, the time t(s) is that at
which the flight crosses the affine hull of the outer paths y_1(s), ..., y_k(s), in direction of the central path. The
weights p(s) are then those that give the point, and b(s) = (dt/ds)^-2.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline

from flatgym.quadrotor import Array
from optimal.flat.initial_guess import central, motion
from optimal.flat.problem import Iterate, PlanningProblem, shared_points, spaces
from optimal.flat.program.parameters import LEAST_SQUARED_SPEED

POINTS = 12
"""Path coordinates for each interval of the grid at which the flight is projected."""
TIMES = 2000
"""Instants among which the crossing of each path coordinate is searched."""
NEWTON_STEPS = 8
"""Newton steps from the nearest instant to the crossing."""
MARGIN = 0.1
"""Weight below zero up to which a crossing counts as one inside the corridor."""
OUTSIDE = 0.01
"""Distance outside the corridor, relative to its greatest width, up to which a flight counts as inside."""
GRAZING = 0.1
"""Sine of the angle between corridor and central path below which the times are interpolated."""
SLOW = 0.05
"""Share of the greatest speed below which times are interpolated: near rest, a crossing is ill-conditioned."""


class OutsideCorridorError(ValueError):
    """A motion leaves the corridor that it should start."""


class Motion(Protocol):
    """A motion of the flat output."""

    @property
    def duration(self) -> float:
        """Time from start to goal [s]."""

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return the output or its derivative of an order below the system's, in time, shape (..., outputs)."""


def projected(problem: PlanningProblem, flight: Motion, nodes: Array) -> Iterate:
    """Return the unknowns of the program that represent a flight.

    Args:
        problem: the problem.
        flight: a motion between the outer paths.
        nodes: the grid, shape (N + 1,).

    Raises:
        ValueError: for a flight of another number of outputs.
        OutsideCorridorError: for a flight that leaves the corridor, naming the place.
    """
    outputs = len(problem.system.outputs)
    if np.shape(flight(0.0)) != (outputs,):
        raise ValueError(
            f"start must be a motion of {outputs} outputs ({', '.join(problem.system.outputs)}), got "
            f"{np.shape(flight(0.0))[-1]}"
        )
    share = np.arange(POINTS) / POINTS
    s = np.append((nodes[:-1, None] + np.diff(nodes)[:, None] * share).ravel(), nodes[-1])
    outer = np.stack([path(s) for path in problem.outer_paths], axis=1)
    inverses = _hull_inverses(outer)
    times = _times(problem, flight, s, outer, inverses)
    weights = _weights(flight(times), outer, inverses, s)
    slowness = make_interp_spline(s, times, k=5).derivative()(s)
    slowness = np.clip(slowness, 0.1 * flight.duration, 10 * flight.duration)
    weight_space, speed_space = spaces(problem.system, nodes, problem.certified)
    coefficients = np.clip(weight_space.nearest(s, weights), 0, 1)[:, :-1]
    fixed = problem.level + 1
    coefficients[:fixed], coefficients[-fixed:] = problem.ends[0, :-1], problem.ends[1, :-1]
    squared = slowness**-2.0 / problem.speed_unit
    speed = np.maximum(speed_space.nearest(s, squared), LEAST_SQUARED_SPEED)
    every = shared_points(nodes, problem.certified)
    # The flight's own jet: that of the splines is noisy, and the attitude sensitive to it where the thrust is small.
    lift, instants = problem.system.lift(), np.interp(every, s, times)
    lifted = lift.values([flight(instants, k) for k in range(problem.system.order)])
    return Iterate(nodes, coefficients, speed, np.clip(lifted, lift.low, lift.high))


def _times(problem: PlanningProblem, flight: Motion, s: Array, outer: Array, inverses: Array) -> Array:
    """Return the increasing times at which a flight crosses the hull of the outer paths at path coordinates, (n,)."""
    duration = flight.duration
    ahead = motion(problem, central(problem, 4)).path(s, 1)
    across = outer[:, :-1] - outer[:, -1:]
    # The part of the central direction that is orthogonal to the hull; all of it, if the hull has full dimension.
    basis = np.linalg.svd(np.swapaxes(across, 1, 2), full_matrices=False)[0]
    beside = ahead - np.einsum("nik,njk,nj->ni", basis, basis, ahead)
    if across.shape[1] >= ahead.shape[1]:
        beside = ahead
    length = np.linalg.norm(beside, axis=1)
    clear = length > GRAZING * np.linalg.norm(ahead, axis=1)
    beside /= np.maximum(length, 1e-12)[:, None]
    grid = np.linspace(0.0, duration, TIMES)
    positions = flight(grid)
    middle = outer.mean(axis=1)
    times, latest = np.zeros(len(s)), 0
    for i in np.flatnonzero(clear[:-1]):
        reached = (positions[latest:] - middle[i]) @ beside[i]
        crossings = np.flatnonzero((reached[:-1] < 0) != (reached[1:] < 0))
        if crossings.size:
            weights = _hull_weights(positions[latest + crossings], outer[i, -1], inverses[i])
            latest += int(crossings[np.argmax(weights.min(axis=1) >= -MARGIN)])  # the first one inside, or the first
        times[i] = grid[latest]
    times[-1] = duration
    for _ in range(NEWTON_STEPS):
        missed = np.einsum("ni,ni->n", flight(times) - middle, beside)
        speed = np.einsum("ni,ni->n", flight(times, 1), beside)
        step = np.where(np.abs(speed) > 1e-9, missed / np.where(np.abs(speed) > 1e-9, speed, 1.0), 0.0)
        times = np.clip(times - np.clip(step, -duration / TIMES, 2 * duration / TIMES), 0.0, duration)
    times[0], times[-1] = 0.0, duration
    speed = np.linalg.norm(flight(times, 1), axis=-1)
    steady = clear & (speed > SLOW * speed.max())
    steady[steady] = np.append(True, np.diff(times[steady]) > 0)
    steady[[0, -1]] = True
    return np.clip(make_interp_spline(s[steady], times[steady], k=3)(s), 0.0, duration)


def _weights(points: Array, outer: Array, inverses: Array, s: Array) -> Array:
    """Return the weights of the outer paths that give points, shape (n, k).

    Raises:
        OutsideCorridorError: for a point that does not lie between the paths.
    """
    width = np.linalg.norm(outer[:, :-1] - outer[:, -1:], axis=2).max(axis=1)
    weights = _hull_weights(points, outer[:, -1], inverses)
    missed = np.linalg.norm(np.einsum("nk,nki->ni", weights, outer) - points, axis=1)
    outside = np.maximum(-weights.min(axis=1) * width, missed) / width.max()
    if outside.max() > OUTSIDE:
        worst = int(np.argmax(outside))
        place = ", ".join(f"{value:.3g}" for value in points[worst])
        raise OutsideCorridorError(
            f"start leaves the corridor at s = {s[worst]:.3f}, near ({place}): its weights there are "
            f"{np.round(weights[worst], 3).tolist()}, and none may be negative"
        )
    return np.asarray(weights)


def _hull_inverses(outer: Array) -> Array:
    """Return the pseudoinverses by which `_hull_weights` projects on the hulls of outer points, (n, k - 1, outputs).

    Args:
        outer: shape (n, k, outputs).
    """
    return np.asarray(np.linalg.pinv(np.swapaxes(outer[:, :-1] - outer[:, -1:], 1, 2)))


def _hull_weights(points: Array, last: Array, inverses: Array) -> Array:
    """Return the weights, with sum 1, of the points nearest to given ones in the affine hulls of outer points, (n, k).

    Args:
        points: shape (n, outputs).
        last: the last outer point, shape (n, outputs), or (outputs,) for all points.
        inverses: of `_hull_inverses`, shape (n, k - 1, outputs), or (k - 1, outputs) for all points.
    """
    first = np.einsum("...ki,...i->...k", inverses, points - last)
    return np.concatenate([first, 1 - first.sum(axis=-1, keepdims=True)], axis=-1)
