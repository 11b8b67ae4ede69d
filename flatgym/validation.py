"""Validation of arguments: each function returns a valid value or raises a ValueError.

The error names the owner, the field, the value and what is allowed.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGNITUDE = 1e6
"""Largest magnitude of a number; larger ones are rejected, so that squares stay far from overflow."""


def number(owner: str, name: str, value: Any) -> float:
    """Return a finite number as a float."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise ValueError(f"{owner}.{name} must be a number, got {value!r}")
    if isinstance(value, (float, np.floating)) and not math.isfinite(value):
        raise ValueError(f"{owner}.{name} must be finite, got {value!r}")
    if not -MAGNITUDE <= value <= MAGNITUDE:
        raise ValueError(f"{owner}.{name} must lie within {MAGNITUDE:g} of zero, got {value!r}")
    return float(value) + 0.0  # +0 for -0, so that equal numbers have equal texts


def positive(owner: str, name: str, value: Any) -> float:
    """Return a positive, finite number as a float."""
    checked = number(owner, name, value)
    if checked <= 0:
        raise ValueError(f"{owner}.{name} must be positive, got {value!r}")
    return checked


def nonnegative(owner: str, name: str, value: Any) -> float:
    """Return a nonnegative, finite number as a float."""
    checked = number(owner, name, value)
    if checked < 0:
        raise ValueError(f"{owner}.{name} must be at least 0, got {checked!r}")
    return checked


def whole(name: str, value: Any, low: int, high: int) -> int:
    """Return an integer in low..high as an int."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not low <= value <= high:
        raise ValueError(f"{name} must be a whole number in {low}..{high}, got {value!r}")
    return int(value)


def choice(what: str, value: Any, known: Iterable[str]) -> str:
    """Return a value that is one of the known names; the error lists them and suggests the nearest.

    Args:
        what: what the value names, such as "scenario".
        value: the value.
        known: the possible values.
    """
    names = list(known)
    if isinstance(value, str) and value in names:
        return value
    alike = {name.lower(): name for name in reversed(names)}
    near = difflib.get_close_matches(str(value).lower(), alike, n=1)
    hint = f"; did you mean {alike[near[0]]!r}?" if near else ""
    raise ValueError(f"unknown {what} {value!r}; known: {', '.join(names) or 'none'}{hint}")


def numbers(name: str, value: Any) -> NDArray[Any]:
    """Return an array of real numbers or booleans, of any shape and dtype."""
    try:
        values = np.asarray(value)
    except (TypeError, ValueError, OverflowError):  # ragged lists
        values = np.empty(0, dtype=object)
    if values.dtype.kind not in "fiub":
        raise ValueError(f"{name} must be an array of numbers, got {value!r}")
    return values


def pair(owner: str, name: str, value: Any, what: str = "two numbers") -> tuple[Any, Any]:
    """Return two values of any type."""
    try:
        one, other = value
    except (TypeError, ValueError):
        raise ValueError(f"{owner}.{name} must be {what}, got {value!r}") from None
    return one, other


def point(owner: str, name: str, value: Any) -> tuple[float, float]:
    """Return a point (x, z) of finite numbers."""
    x, z = pair(owner, name, value, "a point (x, z) in metres")
    return number(owner, f"{name}[0]", x), number(owner, f"{name}[1]", z)
