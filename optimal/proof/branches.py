"""Branches of a proof: classes of flights by winding and tilts, and whether they cover all flights.

A flight of duration T belongs to a branch if it has the winding of the branch, and its tilt is within the bounds of the
branch at the given instants. Instants are shares of T. A branch without a winding contains all flights.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple


class TiltInterval(NamedTuple):
    """A bound of the tilt: within [low, high] [rad] at the time share T."""

    share: float
    low: float
    high: float


@dataclass(frozen=True)
class Branch:
    """A class of flights.

    Attributes:
        winding: whole turns of the tilt between start and end; None for any.
        held: bounds of the tilt at some instants; none without a winding.
    """

    winding: int | None = None
    held: tuple[TiltInterval, ...] = ()

    def halve_tilt(self, share: float, reach: tuple[float, float]) -> list[Branch]:
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


Box = dict[float, tuple[float, float]]
"""Intervals of the tilt by the share of T at which they hold."""


def covered(branches: Iterable[Branch], windings: Iterable[int]) -> bool:
    """Return whether every flight with one of the windings belongs to one of the branches."""
    branches = list(branches)
    if any(branch.winding is None and not branch.held for branch in branches):
        return True
    return all(_covered([_box(branch) for branch in branches if branch.winding == winding], {}) for winding in windings)


def _box(branch: Branch) -> Box:
    """Return the intervals of a branch as a box. Several bounds at one instant are intersected."""
    box: Box = {}
    for share, low, high in branch.held:
        least, most = box.get(share, (-math.inf, math.inf))
        box[share] = (max(low, least), min(high, most))
    return box


def _covered(boxes: Sequence[Box], whole: Box) -> bool:
    """Return whether boxes cover a whole.

    The whole is cut at an end of one box recursively, until one box covers each piece.
    """
    if not boxes:
        return False
    for share, (low, high) in boxes[0].items():
        least, most = whole.get(share, (-math.inf, math.inf))
        for end in (low, high):
            if least < end < most:
                pieces = [whole | {share: (least, end)}, whole | {share: (end, most)}]
                return all(_covered([box for box in boxes if _meets(box, piece)], piece) for piece in pieces)
    return True


def _meets(box: Box, piece: Box) -> bool:
    """Return whether a box and a piece intersect in more than their boundary."""
    return all(
        max(low, piece.get(share, (-math.inf, math.inf))[0]) < min(high, piece.get(share, (-math.inf, math.inf))[1])
        for share, (low, high) in box.items()
    )
