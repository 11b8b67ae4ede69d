"""Scores as text, the same in the README, on the terminal and on the report page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from experiments.files import Row
from experiments.formats import format_percent


def format_success(row: Row) -> str:
    """Return a success rate with its interval, such as "97 % [94, 99]"; without one where it is a point."""
    low, high = row["success_low"], row["success_high"]
    interval = "" if low == high else f" [{100 * low:.0f}, {100 * high:.0f}]"
    return f"{format_percent(row['success_rate'])}{interval}"


def format_gap(row: Row, interval: bool = True) -> str:
    """Return a gap with its interval, such as "+4.2 % [3.9, 4.6]"; a dash where no episode succeeded."""
    if np.isnan(row["gap"]):
        return "-"
    low, high = row["gap_low"], row["gap_high"]
    bounds = "" if low == high or not interval else f" [{100 * low:.1f}, {100 * high:.1f}]"
    return f"{100 * row['gap']:+.1f} %{bounds}"


def format_count(count: float) -> str:
    """Return a number of steps in thousands or millions; a dash for none."""
    if not count:
        return "-"
    return f"{count / 1e6:.2f} M" if count >= 1e6 else f"{count / 1e3:.1f} k"


def describe_disturbances(active: dict[str, float]) -> str:
    """Return active disturbances and their strengths in words."""
    texts = {
        "wind": lambda value: f"wind up to {value:g} m/s²",
        "mass": lambda value: f"mass within {100 * value:g} %",
        "action_delay": lambda value: f"actions up to {value:g} step late",
    }
    return ", ".join(texts[name](value) if name in texts else f"{name} {value:g}" for name, value in active.items())


def join_names(names: Sequence[str]) -> str:
    """Return names as a list in a sentence, "none" for no names."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names) or "none"
