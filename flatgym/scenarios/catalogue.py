"""The named scenarios of the benchmark, and the lookup by name."""

from __future__ import annotations

import json
from types import MappingProxyType
from typing import Any, TypeAlias

from flatgym.scenarios.content import hint
from flatgym.scenarios.distributions import DISTRIBUTIONS, Distribution
from flatgym.scenarios.scenario import Hoop, Scenario
from flatgym.scenarios.tracks import TRACKS

ScenarioLike: TypeAlias = str | Scenario
"""A name of SCENARIOS, a scenario as a JSON text, or a Scenario."""
Problem: TypeAlias = Scenario | Distribution
"""Tasks of an environment."""
ProblemLike: TypeAlias = str | Problem
"""A name of SCENARIOS or DISTRIBUTIONS, a scenario as a JSON text, a Scenario or a Distribution."""

_NAMED = (
    *(Scenario(f"horizontal-{d}", (0.0, 0.0), (float(d), 0.0)) for d in (3, 6, 9, 12, 15)),
    Scenario("ground-6", (0.0, 0.0), (6.0, 0.0), floor=0.0),
    Scenario("diagonal", (0.0, 0.0), (5.0, 5.0)),
    Scenario("hoop", (0.0, 0.0), (5.0, 5.0), hoops=(Hoop(2.5, 2.5, 0.5),)),
    Scenario("climb", (0.0, 0.0), (0.0, 5.0)),
    Scenario("drop", (0.0, 0.0), (0.0, -5.0)),
    Scenario("high-hoop", (0.0, 0.0), (5.0, 5.0), hoops=(Hoop(2.5, 4.25, 0.5),)),
    *TRACKS,
)

SCENARIOS = MappingProxyType({scenario.name: scenario for scenario in _NAMED})
"""The named scenarios, by name (read-only)."""

DEFAULT_SCENARIO = "hoop"


def scenario(name: ScenarioLike) -> Scenario:
    """Return the named scenario; a Scenario is returned as it is, a JSON text is parsed.

    JSON texts let Gymnasium environment specifications, which must be plain data, hold any scenario.

    Raises:
        ValueError: for an unknown name, with the known names and the closest one, and for a distribution.
        TypeError: for other types.
    """
    found = problem(name)
    if isinstance(found, Distribution):
        raise ValueError(
            f"{found.name!r} is a distribution of scenarios; sample one: "
            f"flatgym.DISTRIBUTIONS[{found.name!r}].scenario(seed, episode)"
        )
    return found


def problem(name: ProblemLike) -> Problem:
    """Return the named scenario or distribution; arguments and errors as for `scenario`."""
    if isinstance(name, (Scenario, Distribution)):
        return name
    if not isinstance(name, str):
        raise TypeError(f"expected the name of a scenario, a Scenario or a Distribution, got {name!r}")
    if name.startswith("{"):
        return from_json(name)
    known = SCENARIOS | DISTRIBUTIONS
    try:
        return known[name]
    except KeyError:
        raise ValueError(f"unknown scenario {name!r}; known: {', '.join(known)}{hint(name, known)}") from None


def from_json(text: str) -> Problem:
    """Return the scenario or distribution of a `to_json`; a ValueError for any other text."""
    try:
        data = json.loads(text)
    except ValueError as error:
        raise ValueError(f"not a scenario: {error}") from None
    return from_dict(data)


def from_dict(data: dict[str, Any]) -> Problem:
    """Return the scenario or distribution of a `to_dict`: that of its `kind`, by default a scenario."""
    kinds: dict[Any, type[Problem]] = {"scenario": Scenario, "distribution": Distribution}
    kind = data.get("kind", "scenario") if isinstance(data, dict) else "scenario"
    if not isinstance(kind, str) or kind not in kinds:
        raise ValueError(f"unknown kind {kind!r}; known: {', '.join(kinds)}{hint(kind, kinds)}")
    return kinds[kind].from_dict(data)
