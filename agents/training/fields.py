"""TODO agents/training/fields.py."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

from flatgym.scenarios import catalogue
from flatgym.validation import MAGNITUDE, nonnegative, number, positive, whole

MOST = 2**62
"""Greatest whole number of a field."""

Seed: TypeAlias = int
"""A whole number in 0..2^32 - 1, as NumPy wants it."""
Natural: TypeAlias = int
"""A whole number, 0 or greater."""
Count: TypeAlias = int
"""A whole number, 1 or greater."""
Real: TypeAlias = float
"""A finite number."""
Positive: TypeAlias = float
"""A number above 0."""
NonNegative: TypeAlias = float
"""A number, 0 or greater."""
Share: TypeAlias = float
"""A number in [0, 1]."""
Factor: TypeAlias = float
"""A number, 1 or greater."""


@dataclass(frozen=True)
class Checked:
    """A configuration whose fields are checked by their types.

    Raises:
        ValueError: naming the field, its value and what is allowed.
    """

    scenario: str = "hoop"
    """Name of the scenario or distribution."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = KINDS[str(field.type)](type(self).__name__, field.name, getattr(self, field.name))
            object.__setattr__(self, field.name, value)
        catalogue.problem(self.scenario)


def _within(low: float, high: float) -> Callable[[str, str, Any], float]:
    def check(owner: str, name: str, value: Any) -> float:
        if not low <= number(owner, name, value) <= high:
            raise ValueError(f"{owner}.{name} must lie in {low:g}..{high:g}, got {value!r}")
        return float(value)

    return check


def _instance(kind: type) -> Callable[[str, str, Any], Any]:
    def check(owner: str, name: str, value: Any) -> Any:
        if not isinstance(value, kind):
            raise ValueError(f"{owner}.{name} must be a {kind.__name__}, got {value!r}")
        return value

    return check


KINDS: dict[str, Callable[[str, str, Any], Any]] = {
    "str": _instance(str),
    "bool": _instance(bool),
    "Seed": lambda owner, name, value: whole(f"{owner}.{name}", value, 0, 2**32 - 1),
    "Natural": lambda owner, name, value: whole(f"{owner}.{name}", value, 0, MOST),
    "Count": lambda owner, name, value: whole(f"{owner}.{name}", value, 1, MOST),
    "Real": number,
    "Positive": positive,
    "NonNegative": nonnegative,
    "Share": _within(0.0, 1.0),
    "Factor": _within(1.0, MAGNITUDE),
}
"""How a field of each type is checked; each returns the value as it is to be stored."""
