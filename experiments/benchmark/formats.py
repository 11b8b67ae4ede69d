"""TODO experiments/benchmark/formats.py."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from experiments.files import Row


def share(row: Row) -> str:
    """Return a success rate with its interval, which is left out where it is a point."""
    low, high = row["success_low"], row["success_high"]
    within = "" if low == high else f" [{100 * low:.0f}, {100 * high:.0f}]"
    return f"{rounded(row['success_rate'])}{within}"


def rounded(rate: float) -> str:
    """Return a success rate in per cent, which is 100 or 0 only where it is."""
    percent = f"{100 * rate:.0f} %"
    return percent if rate in (0, 1) or percent not in ("100 %", "0 %") else f"{100 * rate:.1f} %"


def gap(row: Row, bounds: bool = True) -> str:
    """Return a gap with its interval; a dash where nothing succeeded."""
    if np.isnan(row["gap"]):
        return "-"
    low, high = row["gap_low"], row["gap_high"]
    within = "" if low == high or not bounds else f" [{100 * low:.1f}, {100 * high:.1f}]"
    return f"{100 * row['gap']:+.1f} %{within}"


def amount(count: float) -> str:
    """Return a number of steps in thousands or millions; a dash for none."""
    if not count:
        return "-"
    return f"{count / 1e6:.2f} M" if count >= 1e6 else f"{count / 1e3:.1f} k"


def strength(active: dict[str, float]) -> str:
    """Return how strong disturbances may be, in words."""
    words = {
        "wind": lambda value: f"wind up to {value:g} m/s²",
        "mass": lambda value: f"mass within {100 * value:g} %",
        "action_delay": lambda value: f"actions up to {value:g} step late",
    }
    return ", ".join(words[name](value) if name in words else f"{name} {value:g}" for name, value in active.items())


def listed(names: Sequence[str]) -> str:
    """Return names as one says them."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names) or "none"
