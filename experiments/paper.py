"""The paper's results beside ours: what it printed, what its transcription gives, what can be flown.

One row a case: Table I (horizontal displacements), the ground constraint, the displacement to
(5, 5), and the hoop. The printed numbers are facts of the paper; all others are computed here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pandas as pd

import optimal

PRINTED = {
    "horizontal-3": 0.8902,
    "horizontal-6": 1.223,
    "horizontal-9": 1.478,
    "horizontal-12": 1.694,
    "horizontal-15": 1.885,
    "ground-6": 1.227,
    "diagonal": 1.289,
    "hoop": None,
}
"""Flight times the paper prints [s]; None where it shows a flight without its time."""

PONTRYAGIN = {
    "horizontal-3": 0.8977,
    "horizontal-6": 1.231,
    "horizontal-9": 1.488,
    "horizontal-12": 1.705,
    "horizontal-15": 1.895,
    "diagonal": 1.4,
}
"""Flight times of the paper's reference [8] as the paper prints them [s]."""

COLUMNS = (
    "scenario",
    "printed_s",
    "nodes_only_s",
    "nodes_only_violation",
    "flat_certified_s",
    "flat_status",
    "shooting_s",
    "reference_8_s",
    "lower_bound_s",
)


def compare(name: str) -> dict[str, Any]:
    """Return the row of one case, keyed by COLUMNS; a road that finds no certified flight leaves inf."""
    nodes = optimal.solve(name, method="flat", checks="nodes", throw=False)
    flat = optimal.solve(name, method="flat", throw=False)
    shooting = optimal.solve(name, throw=False)
    return {
        "scenario": name,
        "printed_s": PRINTED[name],
        "nodes_only_s": nodes.time,
        "nodes_only_violation": nodes.certificate.max_control_violation,
        "flat_certified_s": flat.time,
        "flat_status": flat.status.value,
        "shooting_s": shooting.time,
        "reference_8_s": PONTRYAGIN.get(name),
        "lower_bound_s": shooting.certificate.lower_bound,
    }


def table(progress: Callable[[], Any] = lambda: None) -> pd.DataFrame:
    """Return all rows; `progress` is called after each."""
    rows = []
    for name in PRINTED:
        rows.append(compare(name))
        progress()
    return pd.DataFrame(rows, columns=list(COLUMNS))
