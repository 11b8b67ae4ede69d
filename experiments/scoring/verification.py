"""Verification of a score file: its flights are replayed and its score is recomputed; nothing that it claims is used.

    verify(content).verdict     # "verified", "fragile" or "refused"

Each flight is replayed six times: in the NumPy environment and in the compiled one, each exactly and with tolerance,
gaps and heights tighter and wider by MARGIN. Where all agree with the claim, the flight does not depend on rounding,
on the implementation or on the machine.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.evaluation.optima import Optima, known_optima, optima
from agents.evaluation.replay import FLEETS, Replay, replay
from agents.evaluation.scores import flight_rows
from experiments.files import Row
from experiments.scoring.claim import NAMES_SHOWN, Claim, Refused, read
from experiments.scoring.score_file import checksum, scored
from flatgym import __version__
from flatgym.scenarios.reference import k_star_digest

MARGIN = 1e-9
"""Margin of tolerance, gaps and heights, far above the rounding of a flight, far below what matters [m, m/s, rad]."""
SAME = 1e-9
"""Largest relative difference of a recomputed number from the claimed one."""
SAME_ACTION = 1e-4
"""Largest difference of the actions of a policy from the recorded ones; another machine rounds networks differently."""
NOT_COMPUTED = ("agent", "algorithm", "env_steps", "wall_time_s", "command", "versions", "proven", "fingerprint")
"""Columns of a score that do not follow from the flights; `proven` may have become true."""


class Verdict(StrEnum):
    """The answer to a score file or a proof."""

    VERIFIED = "verified"
    FRAGILE = "fragile"
    REFUSED = "refused"


@dataclass(frozen=True)
class Verification:
    """The result of a verification.

    Attributes:
        verdict: the answer.
        reason: why, a sentence.
        score: the recomputed score; empty if refused.
    """

    verdict: Verdict
    reason: str
    score: Row = field(default_factory=dict)


def verify(content: Mapping[str, Any], store: str | Path | None = None) -> Verification:
    """Replay the flights of a score file, and recompute its score.

    Args:
        content: of the file.
        store: folder that caches K* of problems that are not in the table.

    Raises:
        SolveFailed: if K* is not in the table and cannot be computed.
    """
    try:
        claim = read(content)
        fragile = replayed(claim)
        score = recomputed(claim, store)
    except Refused as refused:
        reason = str(refused)
        if content.get("checksum") != checksum(content):
            reason += "; the checksum does not match the content either"
        return Verification(Verdict.REFUSED, f"Refused: {reason}.")
    if content.get("checksum") != checksum(content):
        return Verification(
            Verdict.REFUSED, "Refused: the checksum does not match the content: the file is damaged or was changed."
        )
    if fragile:
        return Verification(Verdict.FRAGILE, f"Fragile: {fragile}.", score)
    reason = (
        "Verified: all flights replay as claimed, in both implementations, also with limits "
        f"{MARGIN:g} tighter and wider."
    )
    if not claim.disturbances.active and any((flight.gap or 0) < 0 for flight in claim.flights):
        reason += " They take fewer steps than K*: the table is wrong; please report it with this file."
    return Verification(Verdict.VERIFIED, reason, score)


def replayed(claim: Claim) -> str:
    """Replay the flights; return what depends on margin or implementation, "" if nothing does.

    Raises:
        Refused: if a flight ends otherwise than claimed, in both implementations.
    """
    actions = [flight.actions for flight in claim.flights]
    exact: dict[str, NDArray[np.bool_]] = {}
    doubts = []
    for name in FLEETS:
        for margin in (0.0, -MARGIN, MARGIN):
            found = replay(claim.problem, claim.seed, actions, claim.disturbances, implementation=name, margin=margin)
            same = as_claimed(claim, found)
            if not margin:
                exact[name], last = same, found
            limits = f"with limits {abs(margin):g} {'tighter' if margin < 0 else 'wider'}" if margin else "exactly"
            how = f"replayed {limits} ({name}),"
            doubts += [f"{_flight(claim, i)}, {how} {_end(found, i)}" for i in np.flatnonzero(~same).tolist()]
    wrong = np.flatnonzero(~np.any(list(exact.values()), axis=0))
    if wrong.size:
        i = int(wrong[0])
        others = f"; so do {wrong.size - 1} others" if wrong.size > 1 else ""
        flight = claim.flights[i]
        raise Refused(
            f"{_flight(claim, i)} is claimed to end with {flight.outcome!r} after {flight.steps} steps, and replayed "
            f"it {_end(last, i)}{others}"
        )
    more = f"; {len(doubts) - NAMES_SHOWN} more" if len(doubts) > NAMES_SHOWN else ""
    return "; ".join(doubts[:NAMES_SHOWN]) + more


def as_claimed(claim: Claim, found: Replay) -> NDArray[np.bool_]:
    """Return which flights of a replay end as claimed, shape (n,)."""
    words = [flight.outcome == word for flight, word in zip(claim.flights, found.outcomes, strict=True)]
    return np.array(words) & (found.steps == [flight.steps for flight in claim.flights])


def _flight(claim: Claim, i: int) -> str:
    return f"flight {i} (seed {claim.seed + i})"


def _end(found: Replay, i: int) -> str:
    if found.outcomes[i] == "flying":
        return f"has not ended after {found.steps[i]} steps"
    return f"ends with {found.outcomes[i]!r} after {found.steps[i]} steps"


def recomputed(claim: Claim, store: str | Path | None) -> Row:
    """Return the score of the flights, computed here.

    Raises:
        Refused: where K* or the score differ from the claimed ones.
    """
    outcomes = tuple(flight.outcome for flight in claim.flights)
    ends = Replay(outcomes, np.array([flight.steps for flight in claim.flights]))
    known, tabled = optima_of(claim, store)
    rows = flight_rows(ends, claim.problem, claim.seed, known=known)
    unlike = [f"K* of {_flight(claim, i)} is {ours:g} here, and {claim.flights[i].k_star!r} there"
              for i, ours in enumerate(rows["k_star"]) if not same(claim.flights[i].k_star, ours)]  # fmt: skip
    table = k_star_digest(claim.problem)
    if unlike or claim.table != table:
        of = "this version" if claim.version == __version__ else f"flatgym {claim.version}, here {__version__}"
        rest = "; ".join(unlike[:NAMES_SHOWN]) or "K* of its own flights agree, others do not"
        kind = f"its table of K* is not ours (it is of {of}): " if claim.table != table else ""
        raise Refused(f"{kind}{rest}")
    for i, gap in enumerate(rows["gap"]):
        if not same(claim.flights[i].gap, gap):
            raise Refused(f"the gap of {_flight(claim, i)} is {gap:.6g}, and {claim.flights[i].gap!r} is claimed")
    names = {key: claim.score.get(key) for key in ("agent", "algorithm", "env_steps", "wall_time_s", "command")}
    score = scored(rows, claim.seed, claim.disturbances, **names)
    for key, value in score.items():
        if key not in NOT_COMPUTED and not same(claim.score.get(key), value):
            raise Refused(f"the {key} of its flights is {value!r}, and {claim.score.get(key)!r} is claimed")
    if tabled and claim.score.get("proven") and not score["proven"]:
        raise Refused("it claims that K* is proven, which it is not here")
    return score


def optima_of(claim: Claim, store: str | Path | None) -> tuple[Optima, bool]:
    """Return K* of the flights, and whether all are in the table.

    K* that is neither in the table nor claimed stays unknown; one that is claimed is computed here. Whether that one is
    proven depends on the machine.
    """
    seeds = claim.seed + np.arange(len(claim.flights))
    known = known_optima(claim.problem, seeds)
    unknown = np.isnan(known.k_star)
    needed = np.flatnonzero(unknown & [flight.k_star is not None for flight in claim.flights])
    if needed.size:
        known.k_star[needed], known.proven[needed] = optima(claim.problem, seeds[needed], store)
    return known, not unknown.any()


def same(claimed: Any, ours: Any) -> bool:
    """Return whether a claimed value is the computed one; NaN is claimed as None."""
    if isinstance(ours, float) and math.isnan(ours):
        return claimed is None
    numbers = [not isinstance(value, bool) and isinstance(value, (int, float)) for value in (claimed, ours)]
    return math.isclose(claimed, ours, rel_tol=SAME, abs_tol=SAME) if all(numbers) else bool(claimed == ours)


def check_fingerprint(claim: Claim, source: str, ours: str | None) -> None:
    """Raise Refused if the fingerprint of a policy is not that of a claim."""
    theirs = claim.policy.get("fingerprint")
    if ours != theirs:
        raise Refused(f"its policy has the fingerprint {theirs}, and {source} has {ours}")


def check_actions(claim: Claim, source: str, flown: Sequence[NDArray[np.float32]]) -> None:
    """Raise Refused if a policy flies other actions, n arrays of shape (K, 2), than those of a claim."""
    for i, (flight, actions) in enumerate(zip(claim.flights, flown, strict=True)):
        if actions.shape != flight.actions.shape or np.abs(actions - flight.actions).max() > SAME_ACTION:
            raise Refused(f"{source} flies {_flight(claim, i)} with other actions than recorded")
