"""Numbers as text, the same on the terminal, in the README's tables and in the report."""

from __future__ import annotations

from math import floor


def percent(share: float, digits: int = 1, sign: str = "") -> str:
    """Return a share as percent, such as "4.9 %"; with `sign="+"` a positive one is written "+4.9 %"."""
    return f"{100 * share:{sign}.{digits}f} %"


def lower_bound(value: float, digits: int = 5) -> str:
    """Return a lower bound rounded down, because a bound rounded up would be false."""
    return f"{floor(value * 10**digits) / 10**digits:.{digits}f}"
