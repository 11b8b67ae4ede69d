"""TODO experiments/paper/verdicts.py."""

from __future__ import annotations

from math import floor
from typing import Any

import pandas as pd

import optimal
from experiments.paper.printed import MAX_GAP, PONTRYAGIN, PRINTED, TIME_BUDGET, impossible, seconds

JUDGED_COLUMNS = (
    "scenario",
    "printed_s",
    "lower_bound_s",
    "flown_s",
    "gap",
    "shortfall_s",
    "shortfall",
    "impossible",
    "reference_8_s",
    "reference_8_impossible",
)


def judge(name: str) -> dict[str, Any]:
    """Return whether the printed time of one case is possible at all, keyed by JUDGED_COLUMNS.

    No flight is faster than `lower_bound_s`, and one takes `flown_s`, the `gap` above it. `shortfall_s` [s] and
    `shortfall` (relative) say how far below the bound the printed time lies; None where it does not. A time that
    is not `impossible` is not excluded, which does not make it possible; None where none is printed.
    """
    proof = optimal.prove(name, max_gap=MAX_GAP, time_budget=TIME_BUDGET)
    bound, printed, reference = proof.time, PRINTED[name], PONTRYAGIN.get(name)
    time_s = seconds(printed)
    shortfall = None if time_s is None or time_s >= bound else bound - time_s
    return {
        "scenario": name,
        "printed_s": time_s,
        "lower_bound_s": bound,
        "flown_s": proof.flown,
        "gap": proof.gap,
        "shortfall_s": shortfall,
        "shortfall": None if shortfall is None else shortfall / bound,
        "impossible": impossible(printed, bound),
        "reference_8_s": seconds(reference),
        "reference_8_impossible": impossible(reference, bound),
    }


def verdicts(judged: pd.DataFrame) -> pd.DataFrame:
    """Return the judged table as one reads it, in words; bounds are rounded down, so that they stay bounds."""

    def verdict(row: dict[str, Any]) -> str:
        if not row["impossible"]:
            return "-" if row["impossible"] is None else "not excluded"
        return f"{row['shortfall_s']:.4f} s, {row['shortfall']:.2%}"

    return pd.DataFrame(
        {
            "case": row["scenario"],
            "printed": PRINTED[row["scenario"]] or "-",
            "bound": f"{floor(row['lower_bound_s'] * 1e5) / 1e5:.5f}",
            "flown": f"{row['flown_s']:.5f}",
            "gap": f"{row['gap']:.3%}",
            "impossible by": verdict(row),
        }
        for row in judged.to_dict("records")
    )


def judgement(judged: pd.DataFrame) -> str:
    """Return in a sentence how many printed times are impossible, and which of reference [8]'s."""
    printed, reference = (judged.set_index("scenario")[of].dropna() for of in ("impossible", "reference_8_impossible"))
    names = [name for name, excluded in reference.items() if excluded]
    which = f" ({', '.join(names)})" if names else ""
    return (
        f"So {sum(printed)} of the paper's {len(printed)} times are impossible, and {len(names)} of the "
        f"{len(reference)} of its reference [8]{which}."
    )
