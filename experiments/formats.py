"""Numbers as text, the same on the terminal, in the README's tables and in the report."""

from __future__ import annotations

from math import floor

SHARES = {"success_rate": "", "success_low": "", "success_high": "", "gap": "+", "gap_low": "+", "gap_high": "+"}
"""Fields of rows that hold shares, and whether they are written with a sign."""
SMALL_GAP = 0.01
"""Gap below which three decimals of a per cent are shown instead of one."""


def percent(share: float, digits: int = 1, sign: str = "") -> str:
    """Return a share as percent, such as "4.9 %"; with `sign="+"` a positive one is written "+4.9 %"."""
    return f"{100 * share:{sign}.{digits}f} %"


def format_percent(rate: float) -> str:
    """Return a rate in per cent; "100 %" and "0 %" are exact, values near them keep a decimal."""
    percent = f"{100 * rate:.0f} %"
    return percent if rate in (0, 1) or percent not in ("100 %", "0 %") else f"{100 * rate:.1f} %"


def share(field: str, value: float) -> str:
    """Return the value of one of SHARES as text, with a sign and enough digits for a gap."""
    if not SHARES[field]:
        return format_percent(value)
    return percent(value, 1 if abs(value) >= SMALL_GAP else 3, SHARES[field])


def lower_bound(value: float, digits: int = 5) -> str:
    """Return a lower bound rounded down, because a bound rounded up would be false."""
    return f"{floor(value * 10**digits) / 10**digits:.{digits}f}"
