"""The records: the best verified flight by a policy on each named scenario, or else the one in K* steps of `optimal`.

verify_record(RECORDS / "hoop.json")["steps"]
refresh(RECORDS)    # after a change of K*
"""

from __future__ import annotations

import json
from pathlib import Path

from agents.evaluation.replay import replay
from agents.evaluation.scores import flight_rows
from experiments.files import ROOT, Row
from experiments.provenance import provenance
from experiments.scoring import score_file
from experiments.scoring.verify_file import verify_file
from flatgym.scenarios.catalogue import SCENARIOS
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.reference import EVALUATION_SEED, k_star_digest, reference

RECORDS = ROOT / "experiments" / "records"
"""Folder of the records in a clone; it is not part of the package."""
OPTIMAL = "optimal"
"""Name of the policy of a flight that no policy has flown."""


def verify_record(path: Path) -> Row:
    """Return the verified score of a record.

    Raises:
        ValueError: with the reason, for a file that is not verified, and for one that is not a record.
    """
    row = verify_file(path, store=None)
    if row["verdict"] != "verified":
        raise ValueError(f"{path.name}: {row['reason']}")
    if path.stem not in SCENARIOS or row.get("scenario") != path.stem:
        raise ValueError(f"{path.name} is of {row.get('scenario')!r}; a record bears the name of its scenario")
    if row["episodes"] != 1 or row["disturbances"] or row["seed"] != EVALUATION_SEED or row["success_rate"] != 1:
        raise ValueError(f"{path.name} must be one successful, undisturbed flight of seed {EVALUATION_SEED}")
    return row


def refresh(folder: Path) -> None:
    """Write the records whose K* is not that of the table, and those that are missing.

    The flight of a policy stays. A scenario without one has the flight in K* steps of the table, by `optimal`.
    """
    for name, scenario in SCENARIOS.items():
        path = folder / f"{name}.json"
        content = json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
        known = reference(name)
        if known is None or (content and content["table"] == k_star_digest(scenario)):
            continue
        if content is None or content["policy"]["name"] == OPTIMAL:
            actions, policy, columns = known.actions, {"name": OPTIMAL, "fingerprint": None}, {"agent": OPTIMAL}
            source = provenance("flatquad publish")
        else:
            (flight,) = content["flights"]
            actions, policy, source = score_file.decode(flight["actions"]), content["policy"], content["provenance"]
            columns = {key: content["score"].get(key) for key in ("agent", "algorithm", "env_steps", "command")}
            columns |= {"fingerprint": policy["fingerprint"]}
        rows = flight_rows(replay(scenario, EVALUATION_SEED, [actions]), scenario, EVALUATION_SEED)
        score = score_file.scored(rows, EVALUATION_SEED, Disturbances(), **columns)
        flights = score_file.flights(rows, [actions])
        score_file.write(path, scenario, Disturbances(), policy, score, flights, source)
