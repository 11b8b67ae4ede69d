"""Outer paths for any scenario: through its hoops, within floor and ceiling, wide in between.

A centre line leads from the start through the hoops to the goal. The outer paths are the corners of
a box (k = 4, room ahead and aside) or the ends of a rib (k = 2, aside only) that travels along it
and is projected onto each gap as it passes. All are B-splines of degree 5 on the same even knots,
and what is to hold for them is arranged for their control points: floor and ceiling, which then
hold everywhere; rest, y' = y'' = 0, by three equal ones at an end; and at the knot of a hoop, where
only five of them count,

    y = (P_-2 + 26 P_-1 + 66 P_0 + 26 P_1 + P_2) / 120,  y' ~ (P_2 + 10 P_1 - 10 P_-1 - P_-2) / 24,

P_j = g + j delta + w_j e with g in the gap, e along it, delta in the direction of passage, w_-j = w_j
and w_0 = -(26 w_1 + w_2) / 33, which gives y = g and y' ~ delta exactly: every weighting of the outer
paths passes the hoop within its gap and in its direction, though they open up around it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Hoop, Scenario
from optimal.paths.curves import BSplinePath, clamped_knots

WIDTH = 1.5
"""Room to either side of the centre line [m]; optimal flights bulge by less between hoops."""
OPENING = np.array([0.06, 0.4])
"""Room beyond the gap one and two control points off a hoop, as shares of WIDTH."""
SPANS, LEAST_SPANS = 8, 6
"""Knot spans of a leg: on average, and at least."""
TURN = 0.5
"""Extra length of a leg for each quarter turn off its chord [m], and the size of a turn on the spot."""
EASE = 0.1
"""Least speed along a leg, relative to its own, below which it counts as turning on the spot."""
SHORTENINGS = 12
"""How often the stride through a hoop near floor or ceiling is halved until it fits."""
STEEPEST = math.pi / 3
"""How far the centre line may pass a hoop off its direction [rad]."""
DEGREE = 5
_CORNERS = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
"""Back up, front up, front down, back down, for a flight to the right."""


@dataclass(frozen=True, eq=False)
class _Gate:
    """The usable part of a gap: centre, half length [m] and direction `across`; control points advance by `stride`."""

    centre: Array
    half: float
    across: Array
    stride: Array


def outer_paths(scenario: Scenario, count: int) -> tuple[BSplinePath, ...]:
    """Return the ends of a rib (count 2) or the corners of a box (count 4) along a scenario's way.

    Raises:
        ValueError: where a hoop cannot be passed, with the reason.
    """
    extents, spans = _legs(scenario)
    band = scenario.heights
    gates = [_gate(scenario, i, min(pair)) for i, pair in enumerate(pairwise(extents / spans))]
    line = _centre_line(scenario, gates, spans)
    sides = np.broadcast_to(_CORNERS, (len(line), 4, 2)) if count == 4 else _ribs(line, gates, spans)
    points = line[:, None] + _room(scenario, line, gates, spans)[:, None, None] * sides
    points[..., 1] = np.clip(points[..., 1], *band)
    opening = WIDTH * OPENING * (scenario.quadrotor.radius == 0)
    for gate, knot in zip(gates, np.cumsum(spans), strict=False):
        at = int(knot) + DEGREE // 2
        points[at - 2 : at + 3] = _through(gate, sides[at], opening, band)
    return tuple(BSplinePath(tuple(map(tuple, points[:, i].tolist())), DEGREE) for i in range(count))


def hoop_parameters(scenario: Scenario) -> Array:
    """Return the s at which the paths of `corridor` pass the hoops, shape (hoops,)."""
    spans = _legs(scenario)[1]
    return np.cumsum(spans)[:-1] / spans.sum()


def _stations(scenario: Scenario) -> Array:
    return np.array([scenario.start, *(hoop.centre for hoop in scenario.hoops), scenario.goal])


def _legs(scenario: Scenario) -> tuple[Array, NDArray[np.intp]]:
    """Return how far each leg would lead at the speed of passage [m], and its share of knot spans.

    From rest one gets half as far as in steady flight, so the first and the last leg count twice.
    """
    chords = np.diff(_stations(scenario), axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    ways = chords / np.maximum(lengths, 1e-9)[:, None]
    for i, hoop in enumerate(scenario.hoops):
        lengths[i : i + 2] += TURN * (1 - ways[i : i + 2] @ hoop.direction)
    extents = lengths.copy()
    extents[0], extents[-1] = 2 * lengths[0], 2 * lengths[-1]
    share = extents / extents.mean()
    return extents, np.maximum(LEAST_SPANS, np.rint(SPANS * share)).astype(np.intp)


def _heading(scenario: Scenario, index: int) -> Array:
    """Return the unit vector along which the centre line passes a hoop.

    A point flies it on its way from the station before to the one after, off the hoop's direction
    by STEEPEST at most; a body flies straight, so as not to touch a rim.
    """
    hoop, stations = scenario.hoops[index], _stations(scenario)
    way = stations[index + 2] - stations[index]
    turn = math.atan2(way @ hoop.across, way @ hoop.direction) if scenario.quadrotor.radius == 0 else 0.0
    turn = min(max(turn, -STEEPEST), STEEPEST)
    return math.cos(turn) * hoop.direction + math.sin(turn) * hoop.across


def _gate(scenario: Scenario, index: int, stride: float) -> _Gate:
    """Return what floor, ceiling and body leave of a gap, if it is to be passed in so long strides."""
    hoop, (low, high), heading = scenario.hoops[index], scenario.heights, _heading(scenario, index)
    half = hoop.half_gap(scenario.quadrotor.radius)
    full = _overlap(hoop, half, low, high)
    for _ in range(SHORTENINGS):
        room = 2 * stride * abs(heading[1])
        ends = _overlap(hoop, half, low + room, high - room)
        if ends is not None and full is not None and ends[1] - ends[0] >= (full[1] - full[0]) / 2 > 0:
            centre = hoop.centre + (ends[0] + ends[1]) / 2 * hoop.across
            return _Gate(centre, (ends[1] - ends[0]) / 2, hoop.across, stride * heading)
        stride /= 2
    raise ValueError(
        f"no corridor for {scenario.name!r}: hoops[{index}], {hoop}, cannot be passed in its direction between "
        f"floor {scenario.floor} and ceiling {scenario.ceiling}; move the hoop, or the limit at fault"
    )


def _overlap(hoop: Hoop, half: float, low: float, high: float) -> tuple[float, float] | None:
    """Return the part of a gap between two heights, as coordinates along `across`; None for no part."""
    slope = hoop.across[1]
    if low > high:
        return None
    if abs(slope) < 1e-12:
        return (-half, half) if low <= hoop.z <= high else None
    first, last = sorted(((low - hoop.z) / slope, (high - hoop.z) / slope))
    first, last = max(first, -half), min(last, half)
    return (first, last) if first < last else None


def _places(spans: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
    """Return on which leg each control point acts, and how far along it (0 to 1), shapes (m,)."""
    count = int(spans.sum()) + DEGREE
    knots = clamped_knots(count, DEGREE) * spans.sum()
    # A control point acts mostly at the mean of its inner knots.
    place = np.array([knots[j + 1 : j + 1 + DEGREE].mean() for j in range(count)])
    leg = np.searchsorted(np.cumsum(spans)[:-1], place, side="right")
    return leg, (place - (np.cumsum(spans) - spans)[leg]) / spans[leg]


def _centre_line(scenario: Scenario, gates: list[_Gate], spans: NDArray[np.intp]) -> Array:
    """Return control points of a curve from the start through the gates to the goal, shape (m, 2)."""
    stations = np.array([scenario.start, *(gate.centre for gate in gates), scenario.goal])
    strides = np.array([np.zeros(2), *(gate.stride for gate in gates), np.zeros(2)])
    leg, within = _places(spans)
    line = np.empty((len(leg), 2))
    for i, n in enumerate(spans):
        line[leg == i] = _leg(stations[i : i + 2], n * strides[i : i + 2])(within[leg == i])
    line[:3], line[-3:] = stations[0], stations[-1]
    return np.clip(line, *np.array([[-math.inf, math.inf], scenario.heights]).T)


def _leg(points: Array, tangents: Array) -> Callable[[Array], Array]:
    """Return the cubic between two points with given tangents, swung out where it would turn on the spot."""
    aside = tangents[0] - tangents[1]
    aside = TURN * np.array([-aside[1], aside[0]]) / max(float(np.hypot(*aside)), 1e-9)
    cubic = CubicHermiteSpline([0.0, 1.0], points, tangents)
    swings = [Polynomial([0, 0, 16, -32, 16]), Polynomial([0, 0, 56, -224, 280, -112])]
    curves = [Polynomial([0.0]), *swings, *(-swing for swing in swings)]

    def ease(swing: Polynomial) -> float:
        tau = np.linspace(0.0, 1.0, 101)[1:-1]
        speed = np.hypot(*(cubic(tau, 1) + swing.deriv()(tau)[:, None] * aside).T)
        resting = np.where(tangents.any(axis=1), 1.0, 0.0)
        expected = (tau + (1 - tau) * resting[0]) * (1 - tau + tau * resting[1])
        return float((speed / expected).min())

    needed = EASE * max(np.hypot(*tangents.T).max(), np.hypot(*(points[1] - points[0])))
    chosen = next((curve for curve in curves if ease(curve) >= needed), max(curves, key=ease))
    return lambda tau: np.asarray(cubic(tau) + chosen(tau)[:, None] * aside)


def _room(scenario: Scenario, line: Array, gates: list[_Gate], spans: NDArray[np.intp]) -> Array:
    """Return the half width of the corridor [m], shape (m,): it opens with the square of the way from a hoop."""
    leg, u = _places(spans)
    after, before = leg > 0, leg < len(spans) - 1
    opened = np.where(after, np.where(before, 4 * u * (1 - u), u * (2 - u)), np.where(before, 1 - u**2, 1.0)) ** 2
    halves = np.array([gate.half for gate in gates])
    ends = np.concatenate([halves[:1], halves, halves[-1:]]) if gates else np.zeros(2)
    room = (1 - u) * ends[leg] + u * ends[leg + 1] + WIDTH * opened
    room[:3], room[-3:] = room[0], room[-1]
    radius = scenario.quadrotor.radius
    for hoop in scenario.hoops if radius > 0 else ():
        for rim in hoop.rims:
            room = np.minimum(room, (np.hypot(*(line - rim).T) - radius) / math.sqrt(2.0))
        for gate, knot in zip(gates, np.cumsum(spans), strict=False):
            near = slice(int(knot) + DEGREE // 2 - 3, int(knot) + DEGREE // 2 + 4)
            room[near] = np.minimum(room[near], gate.half)
    return np.maximum(room, 0.0)


def _ribs(line: Array, gates: list[_Gate], spans: NDArray[np.intp]) -> Array:
    """Return unit vectors to the left and right of the centre line, upright at both ends, shape (m, 2, 2)."""
    steps = line[2:] - line[:-2]
    moving = np.hypot(*steps.T) > 1e-9
    raw = np.arctan2(steps[:, 1], steps[:, 0])
    heading = np.interp(np.arange(len(line)), np.flatnonzero(moving) + 1, np.unwrap(raw[moving]))
    index = np.arange(len(line))
    end = np.where(index < len(line) / 2, heading[0], heading[-1])
    upright = np.rint(end / np.pi) * np.pi
    share = np.clip((np.minimum(index, index[::-1]) - 2) / 3, 0.0, 1.0)
    angle = upright + share * (heading - upright) + np.pi / 2
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for gate, knot in zip(gates, np.cumsum(spans), strict=False):
        normal[int(knot) + DEGREE // 2] = gate.across
    return np.stack([normal, -normal], axis=1)


def _through(gate: _Gate, sides: Array, opening: Array, band: tuple[float, float]) -> Array:
    """Return five control points for each path that pass a gate straight, shape (5, k, 2).

    Args:
        gate: what to pass.
        sides: where each path stands off the centre line, shape (k, 2); projected onto the gap.
        opening: room beyond the gap at the first and second control point off it [m].
        band: least and greatest height [m].
    """
    aside = sides @ gate.across
    aside = (aside / np.abs(aside).max())[:, None] * gate.across
    straight = gate.centre + gate.half * aside + np.arange(-2, 3)[:, None, None] * gate.stride
    near, far = opening
    widths = np.array([far, near, -(26 * near + far) / 33, near, far])
    spread = widths[:, None, None] * aside
    # Where floor or ceiling is near, a path opens by as much as fits, so that it still passes exactly.
    rise = spread[..., 1]
    room = np.where(rise > 0, band[1] - straight[..., 1], straight[..., 1] - band[0])
    share = np.where(np.abs(rise) > 1e-12, room / np.maximum(np.abs(rise), 1e-12), 1.0)
    points = straight + np.clip(share.min(axis=0), 0.0, 1.0)[:, None] * spread
    points[..., 1] = np.clip(points[..., 1], *band)
    return points
