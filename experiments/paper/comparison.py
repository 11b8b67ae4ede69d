"""The flight times of one case: printed in the paper, by its transcription, and by each method within all limits."""

from __future__ import annotations

from typing import Any

import optimal
from experiments.paper.printed import MAX_GAP, PONTRYAGIN, PRINTED, TIME_BUDGET, in_free_space, seconds
from flatgym import SCENARIOS
from optimal.indirect.pontryagin import fastest

COLUMNS = (
    "scenario",
    "printed_s",
    "nodes_only_s",
    "nodes_only_violation",
    "flat_certified_s",
    "flat_status",
    "shooting_s",
    "pontryagin_s",
    "reference_8_s",
    "lower_bound_s",
)


def compare(name: str) -> dict[str, Any]:
    """Return the row of one case, keyed by COLUMNS.

    A time is inf where the method finds no certified flight. It is None where the paper prints none, or where the
    method does not apply.
    """
    # The lower bound does not depend on the method: it is proven once, with the last solve.
    nodes = optimal.solve(name, method="flat", checks="nodes", max_gap=None, raise_on_failure=False)
    flat = optimal.solve(name, method="flat", corridor="fixed", max_gap=None, raise_on_failure=False)
    shooting = optimal.solve(name, max_gap=MAX_GAP, time_budget=TIME_BUDGET, raise_on_failure=False)
    return {
        "scenario": name,
        "printed_s": seconds(PRINTED[name]),
        "nodes_only_s": nodes.time,
        "nodes_only_violation": nodes.certificate.max_control_violation,
        "flat_certified_s": flat.time,
        "flat_status": flat.status.value,
        "shooting_s": shooting.time,
        "pontryagin_s": fastest(SCENARIOS[name]).time if in_free_space(name) else None,
        "reference_8_s": seconds(PONTRYAGIN.get(name)),
        "lower_bound_s": shooting.certificate.lower_bound,
    }
