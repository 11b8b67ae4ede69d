"""The named scenarios of the benchmark, and the lookup by name or file."""

from __future__ import annotations

import os
import re
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

from flatgym.scenarios.content import hint, parse_json
from flatgym.scenarios.distributions import DISTRIBUTIONS, Distribution
from flatgym.scenarios.files import SUFFIXES, from_dict, load
from flatgym.scenarios.scenario import Hoop, Scenario
from flatgym.scenarios.tracks import TRACKS

ScenarioLike: TypeAlias = str | os.PathLike[str] | Scenario
"""A name, a TOML or JSON file, a scenario as a JSON text, or a Scenario."""
Problem: TypeAlias = Scenario | Distribution
"""Tasks of an environment."""
ProblemLike: TypeAlias = str | os.PathLike[str] | Problem | dict[str, Any]
"""A name, a TOML or JSON file, a task as a JSON text or as its dict, a Scenario or a Distribution."""

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
SAMPLE = re.compile(r"(.+)-(\d{1,18})-(\d{1,18})", re.ASCII)
"""Name of a sample of a distribution: name, seed, episode."""


def scenario(name: ScenarioLike) -> Scenario:
    """Return a scenario by its name or from its file; a Scenario is returned as it is, a JSON text is parsed.

    Names are those of SCENARIOS, and NAME-SEED-EPISODE for a sample of a distribution, such as random-hoops-3-0. JSON
    texts let Gymnasium environment specifications, which must be plain data, hold any scenario.

    Raises:
        ValueError: for an unknown name, with the known names and the closest one, for a file that is missing or not a
            scenario, and for a distribution.
        TypeError: for other types.
    """
    found = problem(name)
    if isinstance(found, Distribution):
        raise ValueError(
            f"{found.name!r} is a distribution of scenarios; sample one by its seed and the number of its episode, "
            f"as Distribution.scenario(0, 0), or a named one as {next(iter(DISTRIBUTIONS))}-0-0"
        )
    return found


def problem(name: ProblemLike) -> Problem:
    """Return a scenario or distribution; arguments and errors as for `scenario`."""
    if isinstance(name, (Scenario, Distribution)):
        return name
    if isinstance(name, os.PathLike):
        return load(name)
    if isinstance(name, dict):
        return _of_dict(name)
    if not isinstance(name, str):
        raise TypeError(f"expected the name of a scenario, a file, a Scenario or a Distribution, got {name!r}")
    if name.startswith("{"):
        return from_dict(parse_json(name))
    if name.endswith(SUFFIXES):
        return load(name)
    if (found := named(name)) is not None:
        return found
    known = [*SCENARIOS, *DISTRIBUTIONS]
    files = [name + suffix for suffix in SUFFIXES if Path(name + suffix).is_file()]
    advice = hint(name, files or known)
    raise ValueError(
        f"unknown scenario {name!r}; known: {', '.join(known)}, NAME-SEED-EPISODE of a distribution, and files "
        f"*{' and *'.join(SUFFIXES)}{advice}"
    )


def _of_dict(data: dict[str, Any]) -> Problem:
    """Return the task of a `to_dict`, and of the fields of a distribution, which datasets hold without the kind."""
    try:
        return from_dict({"kind": "distribution"} | data if "half_width" in data else data)
    except ValueError as error:
        raise ValueError(f"not a scenario: {error}") from None


def named(name: str) -> Problem | None:
    """Return the scenario, distribution or sample of a distribution of that name; None if there is none."""
    found = SCENARIOS.get(name) or DISTRIBUTIONS.get(name)
    if found is None and (sample := SAMPLE.fullmatch(name)) and sample[1] in DISTRIBUTIONS:
        return DISTRIBUTIONS[sample[1]].scenario(int(sample[2]), int(sample[3]))
    return found


def text(task: ProblemLike) -> str:
    """Return a task as a string that `problem` reads anywhere: its name if that names its content, else JSON text."""
    found = problem(task)
    return found.name if named(found.name) == found else found.to_json()


def label(task: ProblemLike) -> str:
    """Return a short name of the content, for tables and file names.

    It is the task's name if that names its content, else the name with the first digits of the digest: a task of one's
    own that is called hoop never passes for `hoop`.
    """
    found = problem(task)
    if named(found.name) == found:
        return found.name
    word = re.sub(r"[^\w.-]+", "-", found.name)[:40]
    return f"{word}-{found.digest[:8]}"
