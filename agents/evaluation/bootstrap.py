"""Uncertainty of scores: interquartile means and bootstrap intervals over runs, episodes and scenarios.

The interquartile mean (IQM) is the mean of the middle half. It is nearly as robust as the median and has less variance.
An interval is the middle 95 % of the statistic under a stratified bootstrap (Agarwal et al., Deep Reinforcement
Learning at the Edge of the Statistical Precipice, 2021). Within each scenario, runs are resampled with replacement (a
run is one training with its seed), then the episodes of each resampled run. One run of many episodes and many runs of
one episode are therefore treated alike. The bootstrap cannot produce unobserved events: the interval of 10 successes
in 10 episodes is a point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flatgym.quadrotor import Array

LEVEL = 0.95
"""Confidence level of an interval."""
RESAMPLES = 1000
STRATUM, RUN = "scenario", "run"


def iqm(values: Any) -> Array:
    """Return the interquartile mean along the last axis, ignoring NaN; NaN if all values are.

    A quarter of the values, rounded down, is cut off at either end, as in scipy.stats.trim_mean(values, 0.25).
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64), axis=-1)  # NaN last
    count = np.sum(~np.isnan(ordered), axis=-1, keepdims=True)
    cut, place = count // 4, np.arange(ordered.shape[-1])
    middle = np.where((place >= cut) & (place < count - cut), ordered, 0.0)
    return _share(middle.sum(axis=-1), (count - 2 * cut)[..., 0])


def mean(values: Any) -> Array:
    """Return the mean along the last axis, ignoring NaN; NaN if all values are."""
    values = np.asarray(values, dtype=np.float64)
    there = ~np.isnan(values)
    return _share(np.where(there, values, 0.0).sum(axis=-1), there.sum(axis=-1))


def _share(total: Any, count: Any) -> Array:
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def bootstrap_positions(rows: pd.DataFrame, seed: int = 0, resamples: int = RESAMPLES) -> NDArray[np.int64]:
    """Return row positions resampled within each scenario: runs first, then the episodes of each run.

    Args:
        rows: one row per episode, with the columns "scenario" and "run"; a missing column counts as constant.
        seed: seed of the bootstrap.
        resamples: number of resamples.

    Returns:
        Shape (resamples, m); padded with -1 where resampled runs have fewer episodes than others.
    """
    generator, positions = np.random.default_rng(seed), []
    for stratum in _groups(rows, STRATUM, np.arange(len(rows))):
        runs = _groups(rows, RUN, stratum)
        counts = np.array([len(run) for run in runs])
        table = np.full((len(runs), counts.max()), -1)
        for i, run in enumerate(runs):
            table[i, : len(run)] = run
        which = generator.integers(len(runs), size=(resamples, len(runs), 1))
        place = generator.integers(counts[which], size=(resamples, len(runs), counts.max()))
        there = np.arange(counts.max()) < counts[which]
        positions.append(np.where(there, table[which, place], -1).reshape(resamples, -1))
    return np.concatenate(positions, axis=1)


def _groups(rows: pd.DataFrame, column: str, places: Any) -> list[Any]:
    """Return row positions grouped by the value of a column, in order of appearance."""
    if column not in rows:
        return [places]
    codes = pd.factorize(rows[column].iloc[places])[0]
    return [places[codes == code] for code in range(codes.max() + 1)]


def interval(
    values: Any, positions: Any, statistic: Callable[[Any], Array] = iqm, level: float = LEVEL
) -> tuple[float, float]:
    """Return the percentile interval of a statistic of values, shape (n,), over the resamples in `positions`.

    Resamples without a value, in which no episode succeeded, are ignored.
    """
    values = np.append(np.asarray(values, dtype=np.float64), np.nan)  # the entry at position -1
    if np.isnan(values).all():
        return float("nan"), float("nan")
    low, high = np.nanquantile(statistic(values[positions]), [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)


def summary(rows: pd.DataFrame, by: Sequence[str] = ("agent", "scenario"), seed: int = 0) -> pd.DataFrame:
    """Return success rate, gap and steps of each group of episodes, with bootstrap intervals of the first two.

    Args:
        rows: one row per episode, as from `agents.episode_rows`, with the columns to group by. A column "run"
            distinguishes trainings with different seeds. Grouped by agent alone, the scenarios of a group are its
            strata.
        by: the columns to group by; groups keep their order of appearance.
        seed: seed of the bootstrap.

    Returns:
        The columns `by`, then runs, episodes, success_rate, success_low, success_high, steps, gap, gap_low, gap_high;
        steps and gap are interquartile means over successes.

    Raises:
        ValueError: for no rows, and for missing columns.
    """
    missing = [name for name in (*by, "outcome", "steps", "gap") if name not in rows]
    if missing or rows.empty:
        raise ValueError(
            f"rows must hold episodes and the columns {', '.join(missing) or 'they have'}, got {len(rows)} rows"
        )
    table = []
    for key, group in rows.groupby(list(by), sort=False, dropna=False):
        positions, success = bootstrap_positions(group, seed), group["outcome"] == "goal"
        gap, steps = group["gap"].where(success), group["steps"].where(success)
        success_low, success_high = interval(success, positions, mean)
        gap_low, gap_high = interval(gap, positions)
        table.append(
            dict(zip(by, key, strict=True))
            | {
                "runs": group[RUN].nunique() if RUN in group else 1,
                "episodes": len(group),
                "success_rate": float(mean(success)),
                "success_low": success_low,
                "success_high": success_high,
                "steps": float(iqm(steps)),
                "gap": float(iqm(gap)),
                "gap_low": gap_low,
                "gap_high": gap_high,
            }
        )
    return pd.DataFrame(table)
