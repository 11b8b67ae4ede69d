"""The centre line: a curve from the start through the gates to the goal, as control points of a B-spline."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.paths.curves import clamped_knots
from optimal.paths.gates import Gate

DEGREE = 5
"""Degree of the B-splines."""
DETOUR = 0.5
"""Lateral amplitude of a leg that would otherwise reverse on the spot [m]."""
LEAST_SPEED = 0.1
"""Least |y'| of a leg, relative to its own scale, below which the leg counts as reversing on the spot."""


def control_point_places(spans: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
    """Return the leg on which each control point acts, and its position along the leg (0 to 1), shape (m,) each."""
    count = int(spans.sum()) + DEGREE
    knots = clamped_knots(count, DEGREE) * spans.sum()
    # The Greville abscissae.
    place = np.array([knots[j + 1 : j + 1 + DEGREE].mean() for j in range(count)])
    leg = np.searchsorted(np.cumsum(spans)[:-1], place, side="right")
    return leg, (place - (np.cumsum(spans) - spans)[leg]) / spans[leg]


def centre_line(scenario: Scenario, gates: list[Gate], spans: NDArray[np.intp]) -> Array:
    """Return the control points of the centre line, shape (m, 2).

    Args:
        scenario: the task.
        gates: the gate of each hoop.
        spans: knot spans of each leg, shape (hoops + 1,).
    """
    stations = np.array([scenario.start, *(gate.centre for gate in gates), scenario.goal])
    strides = np.array([np.zeros(2), *(gate.stride for gate in gates), np.zeros(2)])
    leg, within = control_point_places(spans)
    line = np.empty((len(leg), 2))
    for i, n in enumerate(spans):
        line[leg == i] = _leg(stations[i : i + 2], n * strides[i : i + 2])(within[leg == i])
    line[:3], line[-3:] = stations[0], stations[-1]
    return np.clip(line, *np.array([[-math.inf, math.inf], scenario.heights]).T)


def _leg(points: Array, tangents: Array) -> Callable[[Array], Array]:
    """Return the cubic between two points with given tangents.

    A lateral detour is added if the cubic would reverse on the spot.
    """
    aside = tangents[0] - tangents[1]
    aside = DETOUR * np.array([-aside[1], aside[0]]) / max(float(np.hypot(*aside)), 1e-9)
    cubic = CubicHermiteSpline([0.0, 1.0], points, tangents)
    shapes = [Polynomial([0, 0, 16, -32, 16]), Polynomial([0, 0, 56, -224, 280, -112])]
    detours = [Polynomial([0.0]), *shapes, *(-shape for shape in shapes)]

    def least_relative_speed(detour: Polynomial) -> float:
        tau = np.linspace(0.0, 1.0, 101)[1:-1]
        speed = np.hypot(*(cubic(tau, 1) + detour.deriv()(tau)[:, None] * aside).T)
        # The expected speed rises linearly from an end at rest.
        moving = np.where(tangents.any(axis=1), 1.0, 0.0)
        expected = (tau + (1 - tau) * moving[0]) * (1 - tau + tau * moving[1])
        return float((speed / expected).min())

    needed = LEAST_SPEED * max(np.hypot(*tangents.T).max(), np.hypot(*(points[1] - points[0])))
    fast_enough = (detour for detour in detours if least_relative_speed(detour) >= needed)
    chosen = next(fast_enough, max(detours, key=least_relative_speed))
    return lambda tau: np.asarray(cubic(tau) + chosen(tau)[:, None] * aside)
