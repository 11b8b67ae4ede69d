"""Score files: a score with the flights behind it, so that anyone can replay and recompute it.

    {"kind": "flatquad-score", "schema": 1, "environment": "FlatQuad-v0",
     "problem": scenario or distribution in full, "digest": its content's, "table": the digest of its stored K*,
     "keywords": disturbances, "policy": name and fingerprint, "score": the row, "flights": one a line,
     "provenance": command, date, versions, machine, "checksum": SHA-256 of all else}

Flight i has the seed score.seed + i. Its actions are the little-endian float32 numbers thrust, rate, thrust, ... in
base64, exact and half the size of decimals: 1,000 flights to random goals take 0.9 MB.

The checksum finds damage. Whoever forges a file can write a new checksum too; what proves a score is the replay
(`experiments.scoring.verification`).
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.evaluation.scores import score_row
from experiments.files import Row, plain
from flatgym.files import write_text
from flatgym.scenarios.catalogue import Problem
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.reference import k_star_digest

KIND, SCHEMA, ENVIRONMENT = "flatquad-score", 1, "FlatQuad-v0"
"""Kind of file, version of its format, and version of the environment."""


def scored(rows: pd.DataFrame, seed: int, disturbances: Disturbances, **columns: Any) -> Row:
    """Return the score of flights with its intervals, computed from one row each as in `agents.episode_rows`."""
    found: Row = plain(dict(score_row(rows, seed, disturbances, **columns).iloc[0]))
    return found


def flights(rows: pd.DataFrame, actions: Sequence[NDArray[np.float32]]) -> list[Row]:
    """Return the flights of a score file, from one row each as in `agents.episode_rows` and their actions."""
    found: list[Row] = plain(
        [
            {"outcome": row.outcome, "steps": row.steps, "k_star": row.k_star, "gap": row.gap, "actions": encode(one)}
            for row, one in zip(rows.itertuples(), actions, strict=True)
        ]
    )
    return found


def write(
    path: Path,
    problem: Problem,
    disturbances: Disturbances,
    policy: Mapping[str, Any],
    score: Row,
    flights: Sequence[Row],
    provenance: Row,
) -> None:
    """Write a score file.

    Args:
        path: the file.
        problem: the scenario or distribution.
        disturbances: those of the flights.
        policy: its name and fingerprint.
        score: of `scored`.
        flights: of `flights`.
        provenance: command, date, versions and machine.
    """
    content = {
        "kind": KIND,
        "schema": SCHEMA,
        "environment": ENVIRONMENT,
        "problem": problem.to_dict(),
        "digest": problem.digest,
        "table": k_star_digest(problem),
        "keywords": asdict(disturbances),
        "policy": dict(policy),
        "score": score,
        "provenance": {key: value for key, value in provenance.items() if key != "schema"},
        "flights": list(flights),
    }
    write_content(path, content)


def write_content(path: Path, content: Row) -> None:
    """Write the content of a score file with its checksum, one line for each value and each flight."""
    content = plain(content)
    head = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items() if key != "flights"]
    rows = ",\n".join(f"  {json.dumps(flight)}" for flight in content["flights"])
    last = f' "flights": [\n{rows}\n ],\n "checksum": "{checksum(content)}"'
    write_text(path, "{\n" + ",\n".join(head) + ",\n" + last + "\n}\n")


def checksum(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of all but the checksum, as JSON with sorted keys and without spaces."""
    rest = {key: value for key, value in content.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def encode(actions: NDArray[np.float32]) -> str:
    """Return actions (K, 2) as text."""
    return base64.b64encode(np.ascontiguousarray(actions, dtype="<f4").tobytes()).decode()


def decode(text: Any) -> NDArray[np.float32]:
    """Return the actions (K, 2) of a text.

    Raises:
        ValueError: for any other text, and for actions outside [-1, 1].
    """
    try:
        data = base64.b64decode(text, validate=True)
    except (TypeError, ValueError, binascii.Error) as error:
        raise ValueError(f"its actions are not base64: {error}") from None
    if len(data) % 8:
        raise ValueError(f"its actions are {len(data)} bytes, not pairs of float32 numbers")
    actions = np.frombuffer(data, dtype="<f4").reshape(-1, 2).astype(np.float32)
    if not (np.abs(actions) <= 1).all():
        raise ValueError("its actions do not lie in [-1, 1]")
    return actions
