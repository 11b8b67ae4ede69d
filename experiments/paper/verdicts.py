"""Verdicts on the printed times: a time below a proven lower bound under the paper's own limits is impossible."""

from __future__ import annotations

from typing import Any

import pandas as pd

import optimal
from experiments.formats import lower_bound, percent
from experiments.paper.printed import MAX_GAP, PONTRYAGIN, PRINTED, TIME_BUDGET, impossible, seconds

VERDICT_COLUMNS = (
    "scenario",
    "printed_s",
    "lower_bound_s",
    "upper_bound_s",
    "gap",
    "shortfall_s",
    "shortfall",
    "impossible",
    "reference_8_s",
    "reference_8_impossible",
)


def check_printed_time(name: str) -> dict[str, Any]:
    """Return whether the printed time of one case is impossible, keyed by VERDICT_COLUMNS.

    No flight is faster than `lower_bound_s`. A certified flight takes `upper_bound_s`, which is the `gap` above it.
    `shortfall_s` [s] and `shortfall` (relative) are the distance of the printed time below the bound, or None if it
    is not below. A time that is not `impossible` is not excluded by the bound; it may still be unattainable.
    `impossible` is None where no time is printed.
    """
    proof = optimal.prove(name, max_gap=MAX_GAP, time_budget=TIME_BUDGET)
    bound, printed, reference = proof.time, PRINTED[name], PONTRYAGIN.get(name)
    time_s = seconds(printed)
    shortfall = None if time_s is None or time_s >= bound else bound - time_s
    return {
        "scenario": name,
        "printed_s": time_s,
        "lower_bound_s": bound,
        "upper_bound_s": proof.flown,
        "gap": proof.gap,
        "shortfall_s": shortfall,
        "shortfall": None if shortfall is None else shortfall / bound,
        "impossible": impossible(printed, bound),
        "reference_8_s": seconds(reference),
        "reference_8_impossible": impossible(reference, bound),
    }


def verdict_texts(verdicts: pd.DataFrame) -> pd.DataFrame:
    """Return the verdicts as text, one row a case; lower bounds are rounded down."""

    def verdict(row: dict[str, Any]) -> str:
        if not row["impossible"]:
            return "-" if row["impossible"] is None else "not excluded"
        return f"{row['shortfall_s']:.4f} s, {percent(row['shortfall'], 2)}"

    return pd.DataFrame(
        {
            "case": row["scenario"],
            "printed": PRINTED[row["scenario"]] or "-",
            "lower bound": lower_bound(row["lower_bound_s"]),
            "T* upper bound": f"{row['upper_bound_s']:.5f}",
            "gap": percent(row["gap"], 3),
            "impossible by": verdict(row),
        }
        for row in verdicts.to_dict("records")
    )


def verdict_summary(verdicts: pd.DataFrame) -> str:
    """Return a sentence with the number of impossible printed times, of the paper and of its reference [8]."""
    by_case = verdicts.set_index("scenario")
    printed, reference = (by_case[key].dropna() for key in ("impossible", "reference_8_impossible"))
    names = [name for name, excluded in reference.items() if excluded]
    which = f" ({', '.join(names)})" if names else ""
    return (
        f"{sum(printed)} of the paper's {len(printed)} times are impossible, and {len(names)} of the "
        f"{len(reference)} of its reference [8]{which}."
    )
