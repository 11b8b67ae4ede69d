"""Gates: the part of each hoop that floor, ceiling and body leave usable, and the legs between hoops."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Hoop, Scenario

SPANS, LEAST_SPANS = 8, 6
"""Knot spans of a leg: average and least number."""
TURN_LENGTH = 0.5
"""Additional length of a leg for each quarter turn between its chord and the direction of a hoop [m]."""
HALVINGS = 12
"""Most halvings of the stride through a hoop near floor or ceiling."""
STEEPEST = math.pi / 3
"""Largest angle between the centre line and the direction of a hoop [rad]."""


@dataclass(frozen=True, eq=False)
class Gate:
    """The usable part of a hoop's gap.

    Attributes:
        centre: its centre [m], shape (2,).
        half: its half length [m].
        across: unit vector along the gap, shape (2,).
        stride: distance between consecutive control points of a path through the gate [m], shape (2,).
    """

    centre: Array
    half: float
    across: Array
    stride: Array


def legs(scenario: Scenario) -> tuple[Array, NDArray[np.intp]]:
    """Return the extent [m] and the number of knot spans of each leg, shape (hoops + 1,) each.

    The extent is the distance covered at the speed of passage in the duration of the leg. A flight from rest covers
    half the distance of a steady flight, so the first and the last leg count twice.
    """
    chords = np.diff(_stations(scenario), axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    directions = chords / np.maximum(lengths, 1e-9)[:, None]
    for i, hoop in enumerate(scenario.hoops):
        lengths[i : i + 2] += TURN_LENGTH * (1 - directions[i : i + 2] @ hoop.direction)
    extents = lengths.copy()
    extents[0], extents[-1] = 2 * lengths[0], 2 * lengths[-1]
    share = extents / extents.mean()
    return extents, np.maximum(LEAST_SPANS, np.rint(SPANS * share)).astype(np.intp)


def hoop_coordinates(scenario: Scenario) -> Array:
    """Return the path coordinates s at which the paths of `corridor` pass the hoops, shape (hoops,)."""
    spans = legs(scenario)[1]
    return np.cumsum(spans)[:-1] / spans.sum()


def gates(scenario: Scenario) -> list[Gate]:
    """Return the gate of each hoop.

    Raises:
        ValueError: if a hoop cannot be passed in its direction between floor and ceiling.
    """
    extents, spans = legs(scenario)
    return [_gate(scenario, i, min(pair)) for i, pair in enumerate(pairwise(extents / spans))]


def _stations(scenario: Scenario) -> Array:
    """Return start, hoop centres and goal, shape (hoops + 2, 2)."""
    return np.array([scenario.start, *(hoop.centre for hoop in scenario.hoops), scenario.goal])


def _heading(scenario: Scenario, index: int) -> Array:
    """Return the unit vector along which the centre line passes a hoop.

    A point passes along the line between the stations before and after, within STEEPEST of the hoop's direction. A body
    with a radius passes in the hoop's direction, so that it does not touch a rim.
    """
    hoop, stations = scenario.hoops[index], _stations(scenario)
    chord = stations[index + 2] - stations[index]
    turn = math.atan2(chord @ hoop.across, chord @ hoop.direction) if scenario.quadrotor.radius == 0 else 0.0
    turn = min(max(turn, -STEEPEST), STEEPEST)
    return math.cos(turn) * hoop.direction + math.sin(turn) * hoop.across


def _gate(scenario: Scenario, index: int, stride: float) -> Gate:
    """Return the gate of a hoop that is passed with strides of at most the given length [m]."""
    hoop, (low, high), heading = scenario.hoops[index], scenario.heights, _heading(scenario, index)
    half = hoop.half_gap(scenario.quadrotor.radius)
    full = overlap(hoop, half, low, high)
    for _ in range(HALVINGS):
        room = 2 * stride * abs(heading[1])
        ends = overlap(hoop, half, low + room, high - room)
        if ends is not None and full is not None and ends[1] - ends[0] >= (full[1] - full[0]) / 2 > 0:
            centre = hoop.centre + (ends[0] + ends[1]) / 2 * hoop.across
            return Gate(centre, (ends[1] - ends[0]) / 2, hoop.across, stride * heading)
        stride /= 2
    raise ValueError(
        f"no corridor for {scenario.name!r}: hoops[{index}], {hoop}, cannot be passed in its direction between "
        f"floor {scenario.floor} and ceiling {scenario.ceiling}; move the hoop, the floor or the ceiling"
    )


def overlap(hoop: Hoop, half: float, low: float, high: float) -> tuple[float, float] | None:
    """Return the part of a gap between two heights, as coordinates along `across`; None if it is empty."""
    slope = hoop.across[1]
    if low > high:
        return None
    if abs(slope) < 1e-12:
        return (-half, half) if low <= hoop.z <= high else None
    first, last = sorted(((low - hoop.z) / slope, (high - hoop.z) / slope))
    first, last = max(first, -half), min(last, half)
    return (first, last) if first < last else None
