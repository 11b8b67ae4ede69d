"""Scenarios and distributions as rows of `flatquad list`, with the keys of a solver's row."""

from __future__ import annotations

from typing import Any

from flatgym import Distribution, Scenario
from flatgym.scenarios.reference import reference


def scenario_row(scenario: Scenario) -> dict[str, Any]:
    """Return a named scenario and its best-known solution."""
    known = reference(scenario)
    return {
        "scenario": scenario.name,
        "kind": "scenario",
        "start": _point(scenario.start),
        "goal": _point(scenario.goal),
        "hoops": len(scenario.hoops),
        "floor": scenario.floor,
        "dt_s": scenario.dt,
        "time_s": known.time if known else None,
        "lower_bound_s": known.time_lower_bound if known else None,
        "k_star": known.k_star if known else None,
        "k_lower_bound": known.k_lower_bound if known else None,
        "proven": known.proven if known else None,
    }


def distribution_row(distribution: Distribution) -> dict[str, Any]:
    """Return a distribution under the same keys; the optima of its scenarios are None."""
    low, high = distribution.hoops
    return {
        "scenario": distribution.name,
        "kind": "distribution",
        "start": _point((0.0, 0.0)),
        "goal": f"within {distribution.half_width:g} m in x and z, at least {distribution.least_distance:g} m away",
        "hoops": low if low == high else f"{low} to {high}",
        "floor": None,
        "dt_s": distribution.dt,
        **dict.fromkeys(("time_s", "lower_bound_s", "k_star", "k_lower_bound", "proven")),
    }


def _point(point: tuple[float, float]) -> str:
    return f"({point[0]:g}, {point[1]:g})"
