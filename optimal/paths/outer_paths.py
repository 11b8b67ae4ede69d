"""Outer paths for any scenario: through its hoops, within floor and ceiling, and wide in between.

A centre line leads from the start through the hoops to the goal. The outer paths are the corners of a box (k = 4, room
along and across the centre line) or the ends of a rib (k = 2, room across only). Box or rib travels along the centre
line and is projected onto each gap as it passes. All outer paths are B-splines of degree 5 on the same even knots.
Their properties are imposed on their control points:

- floor and ceiling: control points within them keep the whole path within them;
- rest, y' = y'' = 0, at an end: three equal control points there;
- passage of a hoop, at the knot of the hoop, where only five control points are active:

    y = (P_-2 + 26 P_-1 + 66 P_0 + 26 P_1 + P_2) / 120,  y' ~ (P_2 + 10 P_1 - 10 P_-1 - P_-2) / 24,

    P_j = g + j delta + w_j e,   w_-j = w_j,   w_0 = -(26 w_1 + w_2) / 33,

with g in the gap, e along the gap and delta in the direction of passage. This gives y = g and y' ~ delta exactly. Every
weighting of the outer paths then passes the hoop within its gap and in its direction, although the paths spread apart
on both sides of it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.paths.centre_line import DEGREE, centre_line, control_point_places
from optimal.paths.curves import BSplinePath
from optimal.paths.gates import Gate, gates, legs

WIDTH = 1.5
"""Room to either side of the centre line [m]. Optimal flights deviate less between hoops."""
OPENING = np.array([0.06, 0.4])
"""Room beyond the gap one and two control points away from a hoop, as shares of WIDTH."""
_CORNERS = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])
"""Corners of the box for a flight to the right: rear top, front top, front bottom, rear bottom."""


def outer_paths(scenario: Scenario, count: int) -> tuple[BSplinePath, ...]:
    """Return the ends of a rib (count 2) or the corners of a box (count 4) along the centre line of a scenario.

    Raises:
        ValueError: if a hoop cannot be passed, with the reason.
    """
    spans, passed = legs(scenario)[1], gates(scenario)
    band = scenario.heights
    line = centre_line(scenario, passed, spans)
    sides = np.broadcast_to(_CORNERS, (len(line), 4, 2)) if count == 4 else _ribs(line, passed, spans)
    points = line[:, None] + _half_widths(scenario, line, passed, spans)[:, None, None] * sides
    points[..., 1] = np.clip(points[..., 1], *band)
    opening = WIDTH * OPENING * (scenario.quadrotor.radius == 0)
    for gate, knot in zip(passed, np.cumsum(spans), strict=False):
        at = int(knot) + DEGREE // 2
        points[at - 2 : at + 3] = _through(gate, sides[at], opening, band)
    return tuple(BSplinePath(tuple(map(tuple, points[:, i].tolist())), DEGREE) for i in range(count))


def _half_widths(scenario: Scenario, line: Array, gates: list[Gate], spans: NDArray[np.intp]) -> Array:
    """Return the half width of the corridor at each control point [m], shape (m,).

    It increases with the square of the distance from a hoop.
    """
    leg, u = control_point_places(spans)
    after, before = leg > 0, leg < len(spans) - 1
    opened = np.where(after, np.where(before, 4 * u * (1 - u), u * (2 - u)), np.where(before, 1 - u**2, 1.0)) ** 2
    halves = np.array([gate.half for gate in gates])
    ends = np.concatenate([halves[:1], halves, halves[-1:]]) if gates else np.zeros(2)
    width = (1 - u) * ends[leg] + u * ends[leg + 1] + WIDTH * opened
    width[:3], width[-3:] = width[0], width[-1]
    radius = scenario.quadrotor.radius
    for hoop in scenario.hoops if radius > 0 else ():
        for rim in hoop.rims:
            width = np.minimum(width, (np.hypot(*(line - rim).T) - radius) / math.sqrt(2.0))
        for gate, knot in zip(gates, np.cumsum(spans), strict=False):
            near = slice(int(knot) + DEGREE // 2 - 3, int(knot) + DEGREE // 2 + 4)
            width[near] = np.minimum(width[near], gate.half)
    return np.maximum(width, 0.0)


def _ribs(line: Array, gates: list[Gate], spans: NDArray[np.intp]) -> Array:
    """Return unit vectors to the left and right of the centre line, vertical at both ends, shape (m, 2, 2)."""
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


def _through(gate: Gate, sides: Array, opening: Array, band: tuple[float, float]) -> Array:
    """Return five control points for each path that pass a gate in a straight line, shape (5, k, 2).

    Args:
        gate: the gate.
        sides: offset of each path from the centre line, projected onto the gap, shape (k, 2).
        opening: room beyond the gap at the first and second control point away from it [m].
        band: least and greatest height [m].
    """
    aside = sides @ gate.across
    aside = (aside / np.abs(aside).max())[:, None] * gate.across
    straight = gate.centre + gate.half * aside + np.arange(-2, 3)[:, None, None] * gate.stride
    near, far = opening
    widths = np.array([far, near, -(26 * near + far) / 33, near, far])
    spread = widths[:, None, None] * aside
    # Near floor or ceiling a path opens by as much as fits, so that it still passes the gate exactly.
    rise = spread[..., 1]
    room = np.where(rise > 0, band[1] - straight[..., 1], straight[..., 1] - band[0])
    share = np.where(np.abs(rise) > 1e-12, room / np.maximum(np.abs(rise), 1e-12), 1.0)
    points = straight + np.clip(share.min(axis=0), 0.0, 1.0)[:, None] * spread
    points[..., 1] = np.clip(points[..., 1], *band)
    return points
