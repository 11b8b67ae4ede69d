"""Verification of a file: a score with its flights, or a proof of a lower bound.

verify_file(Path("score.json"), store=None)["verdict"]
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from experiments.files import Row
from experiments.scoring import claim as claims
from experiments.scoring.proofs import verify_proof
from experiments.scoring.score import fly_submission
from experiments.scoring.submission import Submission
from experiments.scoring.verification import Verdict, Verification, check_actions, check_fingerprint, verify

SHOWN = ("scenario", "agent", "seed", "episodes", "success_rate", "success_low", "success_high", "steps", "k_star",
         "proven", "gap", "gap_low", "gap_high", "outcomes", "disturbances")  # fmt: skip
"""Columns of the score in the answer."""


def verify_file(
    path: Path,
    store: Path | None,
    policy: str = "",
    trust: bool = False,
    timeout: float = 300.0,
    normalize: str = "",
) -> Row:
    """Return the answer for a file as a row: file, verdict, reason, and the recomputed score, or what is proven.

    Args:
        path: the file.
        store: folder of K* that have been computed.
        policy: a policy to compare with that of the score file, as for `Submission.policy`.
        trust: whether to load a zip from any folder.
        timeout: time limit for the policy [s].
        normalize: file of the policy's VecNormalize statistics, "" for those beside a zip.

    Raises:
        OSError: if there is no such file.
        Failed: where the policy fails or hangs.
        ValueError: for a policy that may not be loaded.
    """
    try:
        content: Any = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        return _row(path, Verification(Verdict.REFUSED, f"Refused: it is damaged or cut short ({error})."))
    if isinstance(content, dict) and "proof" in content:
        return verify_proof(path)
    if not isinstance(content, dict):
        return _row(path, Verification(Verdict.REFUSED, "Refused: it is neither a score file nor a proof."))
    found = verify(content, store)
    if policy and found.verdict is not Verdict.REFUSED:
        found = _with_policy(content, found, store, timeout, policy=policy, trust=trust, normalize=normalize)
    return _row(path, found) | {key: found.score[key] for key in SHOWN if key in found.score}


def _with_policy(content: Row, found: Verification, store: Path | None, timeout: float, **policy: Any) -> Verification:
    """Return a verification that also holds for a policy, given by fields of a Submission."""
    claim = claims.read(content)
    submission = Submission(
        **policy,
        scenario=claim.problem.to_json(),
        episodes=len(claim.flights),
        seed=claim.seed,
        disturbances=claim.disturbances,
    )
    try:
        flown = fly_submission(submission, store, timeout)
        check_fingerprint(claim, submission.policy, flown.columns["fingerprint"])
        check_actions(claim, submission.policy, flown.actions)
    except claims.Refused as refused:
        return Verification(Verdict.REFUSED, f"Refused: {refused}.")
    return Verification(found.verdict, f"{found.reason} {submission.policy} flies the same actions.", found.score)


def _row(path: Path, found: Verification) -> Row:
    return {"file": str(path), "verdict": found.verdict.value, "reason": found.reason}
