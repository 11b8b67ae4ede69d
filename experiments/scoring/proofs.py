"""Verification of a saved proof by the second checker, `optimal.proof.independent`.

verify_proof(Path("proof.json"))["verdict"]
"""

from __future__ import annotations

from pathlib import Path

from experiments.files import Row
from experiments.scoring.verification import Verdict
from flatgym.scenarios.catalogue import SCENARIOS
from flatgym.scenarios.scenario import Scenario
from optimal.discrete.step_bound import relaxed_scenario
from optimal.proof.independent.checker import recheck
from optimal.proof.independent.reading import TooLarge
from optimal.proof.lower_bound import Proof

SECOND, OWN = "second checker", "prover's own check"
"""Names of the checkers."""


def verify_proof(path: Path) -> Row:
    """Return the answer for a proof: file, verdict, reason, checker, scenario, and the time or steps that it excludes.

    A proof that is too large for the second checker is checked by `Proof.check`, and the reason says so.
    """
    try:
        proof = Proof.load(path)
        checker, note = SECOND, ""
        try:
            holds = recheck(path)
        except TooLarge as error:
            checker, note, holds = OWN, f" The second checker did not decide it: {error}.", proof.check()
    except ValueError as error:
        return _row(path, Verdict.REFUSED, f"Refused: it is {error}.")
    if not holds:
        return _row(path, Verdict.REFUSED, f"Refused: the {checker} does not confirm it.{note}") | {"checker": checker}
    what = f"flight takes {proof.steps} steps or fewer" if proof.steps else f"flight takes less than {proof.time:.6g} s"
    return _row(path, Verdict.VERIFIED, f"Verified: no {what}.{note}") | {
        "checker": checker,
        "scenario": proof.scenario.name,
        "content": content_of(proof.scenario),
        "digest": proof.scenario.digest,
        "tolerance": "exact rest" if proof.tolerance is None else "goal tolerance",
        "time_s": proof.time,
        "steps": proof.steps or None,
    }


def content_of(scenario: Scenario) -> str:
    """Return whether a scenario is the one of its name here; K* is proven for one relaxed by rounding."""
    known = SCENARIOS.get(scenario.name)
    if known is not None and scenario == known:
        return "as in this version"
    if known is not None and scenario == relaxed_scenario(known):
        return "as in this version, relaxed by rounding"
    return "its own"


def _row(path: Path, verdict: Verdict, reason: str) -> Row:
    return {"file": str(path), "verdict": verdict.value, "reason": reason}
