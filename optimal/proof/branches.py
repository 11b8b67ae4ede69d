"""Branches of a proof: classes of flights by winding, tilts and passing times, and whether they cover all flights.

A flight of duration T belongs to a branch if it has the winding of the branch, its tilt is within the bounds of the
branch at the given instants, and it passes the given hoops within the given times. Times are shares of T. A branch
without a winding contains all flights.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

KeyT = TypeVar("KeyT", int, float)
Interval = tuple[float, float]


class TiltInterval(NamedTuple):
    """A bound of the tilt: within [low, high] [rad] at the time share T."""

    share: float
    low: float
    high: float


class PassingInterval(NamedTuple):
    """A bound of the time at which a hoop is passed: within [low, high], shares of T."""

    hoop: int
    low: float
    high: float


@dataclass(frozen=True)
class Branch:
    """A class of flights.

    Attributes:
        winding: whole turns of the tilt between start and end; None for any.
        held: bounds of the tilt at some instants; none without a winding.
        passing: bounds of the passing times of some hoops; none without a winding.
    """

    winding: int | None = None
    held: tuple[TiltInterval, ...] = ()
    passing: tuple[PassingInterval, ...] = ()

    def split_tilt(self, share: float, angle: float) -> list[Branch]:
        """Return the two parts of the branch in which the tilt at an instant is at most and at least an angle [rad]."""
        # The outermost parts stay unbounded outwards, because the reachable tilts grow with T.
        parts = _split({held[0]: held[1:] for held in self.held}, share, angle)
        return [replace(self, held=tuple(TiltInterval(at, *each) for at, each in part.items())) for part in parts]

    def split_passing(self, hoop: int, share: float) -> list[Branch]:
        """Return the two parts of the branch in which a hoop is passed at a share of T at the latest and earliest."""
        parts = _split({passing[0]: passing[1:] for passing in self.passing}, hoop, share)
        return [
            replace(self, passing=tuple(PassingInterval(int(i), *each) for i, each in part.items())) for part in parts
        ]


def _split(intervals: dict[KeyT, Interval], at: KeyT, middle: float) -> list[dict[KeyT, Interval]]:
    """Return the intervals twice, with the one at a key up to the middle, and from there on."""
    low, high = intervals.get(at, (-math.inf, math.inf))
    return [intervals | {at: (low, middle)}, intervals | {at: (middle, high)}]


Box = dict[tuple[str, float], Interval]
"""Intervals of the tilt by the share of T at which they hold, and of the passing times by hoop."""


def covered(branches: Iterable[Branch], windings: Iterable[int]) -> bool:
    """Return whether every flight with one of the windings belongs to one of the branches."""
    branches = list(branches)
    if any(branch.winding is None and not (branch.held or branch.passing) for branch in branches):
        return True
    return all(_covered([_box(branch) for branch in branches if branch.winding == winding], {}) for winding in windings)


def _box(branch: Branch) -> Box:
    """Return the intervals of a branch as a box. Several bounds of the same quantity are intersected."""
    box: Box = {}
    bounds = [*(("tilt", *held) for held in branch.held), *(("passing", *passing) for passing in branch.passing)]
    for kind, at, low, high in bounds:
        least, most = box.get((kind, at), (-math.inf, math.inf))
        box[kind, at] = (max(low, least), min(high, most))
    return box


def _covered(boxes: Sequence[Box], whole: Box) -> bool:
    """Return whether boxes cover a whole.

    The whole is cut at an end of one box recursively, until one box covers each piece.
    """
    if not boxes:
        return False
    for key, (low, high) in boxes[0].items():
        least, most = whole.get(key, (-math.inf, math.inf))
        for end in (low, high):
            if least < end < most:
                pieces = [whole | {key: (least, end)}, whole | {key: (end, most)}]
                return all(_covered([box for box in boxes if _meets(box, piece)], piece) for piece in pieces)
    return True


def _meets(box: Box, piece: Box) -> bool:
    """Return whether a box and a piece intersect in more than their boundary."""
    return all(
        max(low, piece.get(key, (-math.inf, math.inf))[0]) < min(high, piece.get(key, (-math.inf, math.inf))[1])
        for key, (low, high) in box.items()
    )
