"""Branches of a proof: classes of flights by winding, passing times and tilts, and whether they cover all flights.

A flight of duration T belongs to a branch if it has the winding of the branch, passes each hoop within the interval of
the branch, and has its tilt within the bounds of the branch at the given instants. Instants are shares of T, so that
one set of branches serves any T. A grid rounds all of them in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

Interval = tuple[float, float]


class TiltInterval(NamedTuple):
    """A bound of the tilt: within [low, high] [rad] at the time share T."""

    share: float
    low: float
    high: float


@dataclass(frozen=True)
class Branch:
    """A class of flights.

    Attributes:
        winding: whole turns of the tilt between start and end.
        passing: for each hoop, the interval of its passing time, as shares of T.
        held: bounds of the tilt at some instants.
    """

    winding: int
    passing: tuple[Interval, ...] = ()
    held: tuple[TiltInterval, ...] = ()

    def halve_passing(self, hoop: int) -> list[Branch]:
        """Return the two halves of the branch by the passing time of a hoop."""
        return [
            replace(self, passing=(*self.passing[:hoop], part, *self.passing[hoop + 1 :]))
            for part in _halves(self.passing[hoop])
        ]

    def halve_tilt(self, share: float, reach: Interval) -> list[Branch]:
        """Return the two halves of the branch by the tilt at an instant.

        Args:
            share: the instant, as a share of T.
            reach: the tilts that are reachable there [rad].
        """
        known = {held.share: held for held in self.held}
        low, high = known[share][1:] if share in known else (-math.inf, math.inf)
        # The outermost parts stay unbounded outwards, because the reachable tilts grow with T.
        middle = (max(low, reach[0]) + min(high, reach[1])) / 2
        rest = tuple(held for held in self.held if held.share != share)
        return [replace(self, held=(*rest, TiltInterval(share, *part))) for part in ((low, middle), (middle, high))]


def _halves(interval: Interval) -> tuple[Interval, Interval]:
    """Return the two halves of an interval."""
    low, high = interval
    middle = (low + high) / 2
    return (low, middle), (middle, high)


Box = dict[tuple[str, float], Interval]
"""Intervals by the quantity they bound: ("passing", hoop) or ("tilt", share)."""


def covered(branches: Iterable[Branch], windows: Sequence[Interval]) -> bool:
    """Return whether every flight of a winding belongs to one of its branches.

    Args:
        branches: all branches of one winding, however they were constructed.
        windows: for each hoop, the interval that contains every possible passing time, as shares of T.
    """
    whole: Box = {("passing", i): window for i, window in enumerate(windows)}
    return _covered([box for box in map(_box, branches) if _meets(box, whole)], whole)


def _box(branch: Branch) -> Box:
    """Return the intervals of a branch as a box."""
    box: Box = {("passing", i): interval for i, interval in enumerate(branch.passing)}
    return box | {("tilt", held.share): (held.low, held.high) for held in branch.held}


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
