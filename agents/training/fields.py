"""Checked field types for configurations: a type and the check of its values, as `Annotated` metadata.

    @dataclass(frozen=True)
    class MyConfig(Checked):
        seed: Seed = 0

A check takes the owner's name, the field's name and a value. It returns the value as it is to be stored, or raises a
ValueError.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Annotated, Any, TypeAlias, get_args, get_origin, get_type_hints

from flatgym.scenarios import catalogue
from flatgym.validation import MAGNITUDE, nonnegative, number, positive, whole

MAX_INT = 2**62
"""Greatest whole number of a field."""
MAX_BINS = 1001
"""Greatest number of bins of an action."""
MOST_TURNS = 100
"""Greatest number of whole turns of the tilt."""
Check: TypeAlias = Callable[[str, str, Any], Any]
"""Takes owner, name and value; returns the value to store."""


@dataclass(frozen=True)
class Whole:
    """Check for whole numbers in low..high."""

    low: int
    high: int = MAX_INT

    def __call__(self, owner: str, name: str, value: Any) -> int:
        """Return the value, or raise a ValueError."""
        return whole(f"{owner}.{name}", value, self.low, self.high)


@dataclass(frozen=True)
class Interval:
    """Check for numbers in [low, high]."""

    low: float
    high: float = MAGNITUDE

    def __call__(self, owner: str, name: str, value: Any) -> float:
        """Return the value as a float, or raise a ValueError."""
        if not self.low <= number(owner, name, value) <= self.high:
            raise ValueError(f"{owner}.{name} must lie in {self.low:g}..{self.high:g}, got {value!r}")
        return float(value)


@dataclass(frozen=True)
class Instance:
    """Check for instances of a type; used for fields without metadata."""

    kind: type

    def __call__(self, owner: str, name: str, value: Any) -> Any:
        """Return the value, or raise a ValueError."""
        if not isinstance(value, self.kind):
            raise ValueError(f"{owner}.{name} must be a {self.kind.__name__}, got {value!r}")
        return value


def levels(owner: str, name: str, value: Any) -> tuple[int, int] | None:
    """Return the numbers of bins of thrust and rate, or None; a ValueError names what is wrong."""
    if value is None:
        return None
    if not isinstance(value, (tuple, list)) or len(value) != 2:
        raise ValueError(f"{owner}.{name} must be two numbers of bins, of thrust and of rate, or None, got {value!r}")
    thrust, rate = (whole(f"{owner}.{name}", count, low, MAX_BINS) for count, low in zip(value, (2, 3), strict=True))
    if rate % 2 == 0:
        raise ValueError(f"{owner}.{name} must have an odd number of rate bins, to hold the rate zero, got {value!r}")
    return thrust, rate


def given_levels(owner: str, name: str, value: Any) -> tuple[int, int]:
    """Return the numbers of bins of thrust and rate; a ValueError names what is wrong."""
    if (found := levels(owner, name, value)) is None:
        raise ValueError(f"{owner}.{name} must be two numbers of bins, of thrust and of rate, got None")
    return found


def whole_turns(owner: str, name: str, value: Any) -> int | None:
    """Return the value, a whole number within MOST_TURNS of zero, or None."""
    return None if value is None else whole(f"{owner}.{name}", value, -MOST_TURNS, MOST_TURNS)


Turns = Annotated[int | None, whole_turns]
"""A number of whole turns of either sign; None for any."""
Bins = Annotated[tuple[int, int] | None, levels]
"""Numbers of bins of thrust and rate; None for none."""
Levels = Annotated[tuple[int, int], given_levels]
"""Numbers of bins of thrust and rate."""
Seed = Annotated[int, Whole(0, 2**32 - 1)]
"""A whole number in 0..2^32 - 1, the seeds NumPy accepts."""
Natural = Annotated[int, Whole(0)]
"""A whole number, 0 or greater."""
Count = Annotated[int, Whole(1)]
"""A whole number, 1 or greater."""
Real = Annotated[float, number]
"""A finite number."""
Positive = Annotated[float, positive]
"""A number above 0."""
NonNegative = Annotated[float, nonnegative]
"""A number, 0 or greater."""
Share = Annotated[float, Interval(0.0, 1.0)]
"""A number in [0, 1]."""
Factor = Annotated[float, Interval(1.0)]
"""A number, 1 or greater."""


@dataclass(frozen=True)
class Checked:
    """A configuration whose fields are checked by their types.

    Raises:
        ValueError: naming the field, its value and the allowed values.
    """

    scenario: str = "hoop"
    """Name of the scenario or distribution, or its file; stored as the name, or else as JSON text."""

    def __post_init__(self) -> None:
        kind: Any = type(self)  # Any, because mypy takes the __hash__ of instances for that of the class
        for name, check in checks(kind).items():
            object.__setattr__(self, name, check(kind.__name__, name, getattr(self, name)))
        # A configuration is stored with its model, so it holds the content of a file and not its path.
        object.__setattr__(self, "scenario", catalogue.text(self.scenario))


@lru_cache
def checks(kind: type[Checked]) -> dict[str, Check]:
    """Return the check of each field of a configuration class."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: _check(hints[field.name]) for field in fields(kind)}


def _check(hint: Any) -> Check:
    """Return the check in a type's metadata, or an instance check for a plain type."""
    if get_origin(hint) is Annotated:
        check: Check = get_args(hint)[1]
        return check
    return Instance(hint)
