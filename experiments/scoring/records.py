"""The records: the best verified flight by a policy on each named scenario.

verify_record(RECORDS / "hoop.json")["steps"]
"""

from __future__ import annotations

from pathlib import Path

from experiments.files import ROOT, Row
from experiments.scoring.verify_file import verify_file
from flatgym.scenarios.catalogue import SCENARIOS
from flatgym.scenarios.reference import EVALUATION_SEED

RECORDS = ROOT / "experiments" / "records"
"""Folder of the records in a clone; it is not part of the package."""


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
