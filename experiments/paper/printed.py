"""The flight times that the paper prints, for itself and for its reference [8], and what rounding allows."""

from __future__ import annotations

from flatgym import SCENARIOS

PRINTED: dict[str, str | None] = {
    "horizontal-3": "0.8902",
    "horizontal-6": "1.223",
    "horizontal-9": "1.478",
    "horizontal-12": "1.694",
    "horizontal-15": "1.885",
    "ground-6": "1.227",
    "diagonal": "1.289",
    "hoop": None,
}
"""Flight times the paper prints [s], with the digits it prints; None where it shows a flight without its time."""

PONTRYAGIN: dict[str, str] = {
    "horizontal-3": "0.8977",
    "horizontal-6": "1.231",
    "horizontal-9": "1.488",
    "horizontal-12": "1.705",
    "horizontal-15": "1.895",
    "diagonal": "1.4",
}
"""Flight times of the paper's reference [8] as the paper prints them [s], with these digits."""
MAX_GAP, TIME_BUDGET = 2e-4, 30.0
"""Relative gap at which the proof of a lower bound stops, and its time budget [s]."""


def seconds(printed: str | None) -> float | None:
    """Return a printed time as a number [s]."""
    return None if printed is None else float(printed)


def rounded_up(printed: str) -> float:
    """Return the longest time that rounds to the printed one [s]: half a unit of the last digit more."""
    return float(printed) + 0.5 * 10.0 ** -len(printed.partition(".")[2])


def impossible(printed: str | None, bound: float) -> bool | None:
    """Return whether every time that rounds to the printed one is below a lower bound [s]; None if none is printed."""
    return None if printed is None else rounded_up(printed) < bound


def in_free_space(name: str) -> bool:
    """Return whether a case has no hoops, floor or ceiling; the indirect method requires this."""
    scenario = SCENARIOS[name]
    return not scenario.hoops and scenario.floor is None and scenario.ceiling is None
