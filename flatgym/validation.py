"""Values as they must be, or a ValueError that names the owner, the field, the value and what is allowed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

MAGNITUDE = 1e6
"""Numbers beyond this are refused: nothing flown is that large, and their squares stay far from overflow."""


def number(owner: str, name: str, value: Any) -> float:
    """Return a finite number as a float."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise ValueError(f"{owner}.{name} must be a number, got {value!r}")
    if isinstance(value, (float, np.floating)) and not math.isfinite(value):
        raise ValueError(f"{owner}.{name} must be finite, got {value!r}")
    if not -MAGNITUDE <= value <= MAGNITUDE:
        raise ValueError(f"{owner}.{name} must lie within {MAGNITUDE:g} of zero, got {value!r}")
    return float(value)


def positive(owner: str, name: str, value: Any) -> float:
    """Return a positive, finite number as a float."""
    checked = number(owner, name, value)
    if checked <= 0:
        raise ValueError(f"{owner}.{name} must be positive, got {value!r}")
    return checked


def point(owner: str, name: str, value: Any) -> tuple[float, float]:
    """Return a point (x, z) of finite numbers."""
    try:
        x, z = value
    except (TypeError, ValueError):
        raise ValueError(f"{owner}.{name} must be a point (x, z) in metres, got {value!r}") from None
    return number(owner, f"{name}[0]", x), number(owner, f"{name}[1]", z)
