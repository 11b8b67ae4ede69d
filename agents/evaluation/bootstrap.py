"""How sure a score is: interquartile means and bootstrap intervals over runs, flights and scenarios.

The interquartile mean (IQM) is the mean of the middle half: robust as the median, and of less variance. An
interval is the middle 95 % of what the statistic is when the data are drawn again from themselves, stratified
(Agarwal et al., Deep Reinforcement Learning at the Edge of the Statistical Precipice, 2021): within each
scenario, runs are drawn with replacement - a run is one training with its seed - and then flights of each drawn
run. So one run of many flights and many runs of one flight are judged alike. What never happened in the data
has no share in it: the interval of 10 successes in 10 flights is a point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from flatgym.quadrotor import Array

LEVEL = 0.95
"""Share of the resampled statistics that an interval holds."""
RESAMPLES = 1000
STRATUM, RUN = "scenario", "run"


def iqm(values: Any) -> Array:
    """Return the interquartile mean along the last axis, leaving out NaN; NaN where there is nothing else.

    A quarter of the values, rounded down, is cut off at either end, as scipy.stats.trim_mean(values, 0.25) does.
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64), axis=-1)  # NaN last
    count = np.sum(~np.isnan(ordered), axis=-1, keepdims=True)
    cut, place = count // 4, np.arange(ordered.shape[-1])
    middle = np.where((place >= cut) & (place < count - cut), ordered, 0.0)
    return _share(middle.sum(axis=-1), (count - 2 * cut)[..., 0])


def mean(values: Any) -> Array:
    """Return the mean along the last axis, leaving out NaN; NaN where there is nothing else."""
    values = np.asarray(values, dtype=np.float64)
    there = ~np.isnan(values)
    return _share(np.where(there, values, 0.0).sum(axis=-1), there.sum(axis=-1))


def _share(total: Any, count: Any) -> Array:
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def resampled(rows: pd.DataFrame, seed: int = 0, resamples: int = RESAMPLES) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Return positions of rows drawn again within each scenario: runs first, then flights of each drawn run.

    Args:
        rows: one a flight, with the columns "scenario" and "run"; a column that is missing has one value only.
        seed: the same seed gives the same draws.
        resamples: how many times.

    Returns:
        Shape (resamples, m); -1 fills up where drawn runs have fewer flights than others.
    """
    generator, drawn = np.random.default_rng(seed), []
    for stratum in _groups(rows, STRATUM, np.arange(len(rows))):
        runs = _groups(rows, RUN, stratum)
        counts = np.array([len(run) for run in runs])
        table = np.full((len(runs), counts.max()), -1)
        for i, run in enumerate(runs):
            table[i, : len(run)] = run
        which = generator.integers(len(runs), size=(resamples, len(runs), 1))
        place = generator.integers(counts[which], size=(resamples, len(runs), counts.max()))
        there = np.arange(counts.max()) < counts[which]
        drawn.append(np.where(there, table[which, place], -1).reshape(resamples, -1))
    return np.concatenate(drawn, axis=1)


def _groups(rows: pd.DataFrame, column: str, places: Any) -> list[Any]:
    """Return the places of rows, split by what stands in a column, in its order of appearance."""
    if column not in rows:
        return [places]
    codes = pd.factorize(rows[column].iloc[places])[0]
    return [places[codes == code] for code in range(codes.max() + 1)]


def interval(
    values: Any, positions: Any, statistic: Callable[[Any], Array] = iqm, level: float = LEVEL
) -> tuple[float, float]:
    """Return the percentile interval of a statistic of values, shape (n,), under draws as `resampled` gives them.

    Draws in which nothing is left to judge - no flight of them succeeded - are left out.
    """
    values = np.append(np.asarray(values, dtype=np.float64), np.nan)  # what -1 points at
    if np.isnan(values).all():
        return float("nan"), float("nan")
    low, high = np.nanquantile(statistic(values[positions]), [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)


def summary(rows: pd.DataFrame, by: Sequence[str] = ("agent", "scenario"), seed: int = 0) -> pd.DataFrame:
    """Return success rate, gap and steps of each group of flights, with bootstrap intervals of the first two.

    Args:
        rows: one a flight, as `agents.evaluate.flight_rows` gives them, and a column for whatever they are grouped
            by; a column "run" tells trainings with different seeds apart. Grouped by agent alone, the scenarios of a
            group are its strata.
        by: the columns to group by, in whose order of appearance the groups stand.
        seed: of the resampling.

    Returns:
        The columns `by`, then runs, flights, success_rate, success_low, success_high, steps, gap, gap_low, gap_high;
        steps and gap are interquartile means over successes.

    Raises:
        ValueError: for no rows, and for columns that are missing.
    """
    missing = [name for name in (*by, "outcome", "steps", "gap") if name not in rows]
    if missing or rows.empty:
        raise ValueError(f"rows need flights and the columns {', '.join(missing) or 'they have'}, got {len(rows)} rows")
    table = []
    for key, group in rows.groupby(list(by), sort=False, dropna=False):
        positions, success = resampled(group, seed), group["outcome"] == "goal"
        gap, steps = group["gap"].where(success), group["steps"].where(success)
        success_low, success_high = interval(success, positions, mean)
        gap_low, gap_high = interval(gap, positions)
        table.append(
            dict(zip(by, key, strict=True))
            | {
                "runs": group[RUN].nunique() if RUN in group else 1,
                "flights": len(group),
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
