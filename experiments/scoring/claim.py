"""The claim of a score file: its content as values, or the reason why it is refused before any flight is replayed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policies.fingerprint import LENGTH, is_fingerprint
from experiments.files import Row
from experiments.scoring.score_file import ENVIRONMENT, KIND, SCHEMA, decode
from flatgym.scenarios.catalogue import SCENARIOS, Problem
from flatgym.scenarios.distributions import DISTRIBUTIONS
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.files import from_dict
from flatgym.task.scene import OUTCOMES

NAMES_SHOWN = 3
"""Most differences that a reason names."""


class Refused(ValueError):
    """A score file is refused; the message is the reason, a part of a sentence."""


@dataclass(frozen=True)
class Flight:
    """What a file claims of one flight.

    Attributes:
        outcome: a word of OUTCOMES.
        steps: environment steps.
        k_star: K*, None if unknown.
        gap: steps / K* - 1 of a success, else None.
        actions: shape (steps, 2).
    """

    outcome: str
    steps: int
    k_star: float | None
    gap: float | None
    actions: NDArray[np.float32]


@dataclass(frozen=True)
class Claim:
    """What a score file claims.

    Attributes:
        problem: the scenario or distribution.
        table: digest of its stored K*, None without any.
        disturbances: those of the flights.
        seed: seed of the first flight.
        flights: the flights.
        score: the score row.
        policy: name and fingerprint.
        version: version of flatgym that wrote the file.
    """

    problem: Problem
    table: str | None
    disturbances: Disturbances
    seed: int
    flights: tuple[Flight, ...]
    score: Row
    policy: Row
    version: str


def read(content: Mapping[str, Any]) -> Claim:
    """Return the claim of a score file's content.

    Raises:
        Refused: for another format, another environment, a changed scenario, and for a flight that is not one.
    """
    if content.get("kind") != KIND:
        raise Refused(f"it is no score file: its kind is {content.get('kind')!r}, not {KIND!r}")
    if content.get("schema") != SCHEMA:
        raise Refused(f"it has schema {content.get('schema')!r}, this version reads {SCHEMA}")
    wanted = {"problem": dict, "digest": str, "table": object, "keywords": dict, "policy": dict, "score": dict}
    for key, kind in (wanted | {"flights": list, "provenance": dict}).items():
        if not isinstance(content.get(key, ...), kind) or key not in content:
            raise Refused(f"it lacks {key!r}, or holds it in another form")
    if content.get("environment") != ENVIRONMENT:
        raise Refused(f"it is of {content.get('environment')!r}, this version flies {ENVIRONMENT}")
    problem, disturbances = _problem(content["problem"], content["digest"]), _disturbances(content["keywords"])
    score, policy = content["score"], content["policy"]
    if score.get("disturbances") != disturbances.active:
        raise Refused(
            f"its keywords {disturbances.active} are not the disturbances of its score, {score.get('disturbances')}"
        )
    seed, count = score.get("seed"), len(content["flights"])
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**63:
        raise Refused(f"its seed is {seed!r}, not a whole number")
    if not count or score.get("episodes") != count:
        raise Refused(f"its score is of {score.get('episodes')!r} episodes, and it holds {count} flights")
    if policy.get("fingerprint") is not None and not is_fingerprint(policy["fingerprint"]):
        raise Refused(f"the fingerprint of its policy is not {LENGTH} hexadecimal digits: {policy['fingerprint']!r}")
    if score.get("fingerprint") != policy.get("fingerprint"):
        raise Refused(
            f"its score is of the policy {score.get('fingerprint')}, and it names {policy.get('fingerprint')}"
        )
    found = tuple(_flight(row, f"flight {i} (seed {seed + i})", problem) for i, row in enumerate(content["flights"]))
    versions = content["provenance"].get("versions")
    version = str(versions.get("flatgym", "unknown")) if isinstance(versions, dict) else "unknown"
    return Claim(problem, content["table"], disturbances, seed, found, score, policy, version)


def _problem(data: Row, digest: str) -> Problem:
    """Return the scenario or distribution; one that bears a known name must be that one."""
    try:
        problem = from_dict(data)
    except (ValueError, TypeError) as error:
        raise Refused(f"its problem is not valid: {error}") from None
    known: Problem | None = (SCENARIOS | DISTRIBUTIONS).get(problem.name)
    if known is not None and known.digest != problem.digest:
        unlike = list(differences(problem.to_dict(), known.to_dict()))
        raise Refused(f"its {problem.name!r} is not that of this version: {'; '.join(unlike[:NAMES_SHOWN])}")
    if digest != problem.digest:
        raise Refused(f"the digest of its {problem.name!r} is not that of the content: {digest!r}")
    return problem


def differences(found: Any, wanted: Any, path: str = "") -> Iterator[str]:
    """Return what differs between two JSON values: "tolerance.position: 0.2, here 0.1"."""
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key in sorted(found.keys() | wanted.keys()):
            yield from differences(found.get(key), wanted.get(key), f"{path}.{key}".lstrip("."))
    elif found != wanted:
        yield f"{path}: {found!r}, here {wanted!r}"


def _disturbances(keywords: Row) -> Disturbances:
    known = asdict(Disturbances())
    if keywords.keys() != known.keys():
        raise Refused(f"its keywords are {', '.join(keywords) or 'none'}, not {', '.join(known)}")
    try:
        return Disturbances(**keywords)
    except ValueError as error:
        raise Refused(f"its keywords are not valid: {error}") from None


def _flight(row: Any, name: str, problem: Problem) -> Flight:
    if not isinstance(row, dict) or not {"outcome", "steps", "k_star", "gap", "actions"} <= row.keys():
        raise Refused(f"{name} lacks outcome, steps, k_star, gap or actions")
    if row["outcome"] not in OUTCOMES[1:]:
        raise Refused(f"{name} has the outcome {row['outcome']!r}, which is none of {', '.join(OUTCOMES[1:])}")
    try:
        actions = decode(row["actions"])
    except ValueError as error:
        raise Refused(f"{name}: {error}") from None
    if row["steps"] != len(actions) or not 1 <= len(actions) <= problem.max_steps:
        raise Refused(
            f"{name} claims {row['steps']!r} steps, has {len(actions)} actions, and may have {problem.max_steps}"
        )
    for key in ("k_star", "gap"):
        if row[key] is not None and (isinstance(row[key], bool) or not isinstance(row[key], (int, float))):
            raise Refused(f"{name}: {key} must be a number or null, got {row[key]!r}")
    return Flight(row["outcome"], len(actions), row["k_star"], row["gap"], actions)
