"""Bootstrap intervals: they contain the estimate, shrink with more data, respect strata, and have nominal coverage."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import trim_mean

from agents.evaluation.bootstrap import bootstrap_positions, interval, iqm, mean, summary


def flights(gap, **columns):
    """Return one row per episode, failed where the gap is NaN."""
    gap = np.asarray(gap, dtype=float)
    outcome = np.where(np.isnan(gap), "floor", "goal")
    return pd.DataFrame(
        {"agent": "a", "scenario": "s", "outcome": outcome, "steps": 50 * (1 + gap), "gap": gap, **columns}
    )


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7, 40, 101])
def test_the_interquartile_mean_equals_scipys(n, generator):
    values = generator.exponential(size=(5, n))
    np.testing.assert_allclose(iqm(values), trim_mean(values, 0.25, axis=-1), rtol=1e-14)
    with_gaps = np.concatenate([values, np.full((5, 3), np.nan)], axis=1)
    with_gaps = generator.permuted(with_gaps, axis=1)
    np.testing.assert_allclose(iqm(with_gaps), iqm(values), rtol=1e-14)
    np.testing.assert_allclose(mean(with_gaps), np.nanmean(with_gaps, axis=-1), rtol=1e-14)


def test_the_mean_of_no_values_is_nan():
    assert np.isnan(iqm([np.nan, np.nan]))
    assert np.isnan(mean([]))


def test_resampling_stays_within_scenarios_and_runs():
    rows = flights(np.zeros(60), scenario=np.repeat(["s", "t"], [20, 40]), run=np.tile([0, 1, 2, 3], 15))
    rows = rows.sample(frac=1, random_state=1)
    drawn = bootstrap_positions(rows, seed=3, resamples=200)
    scenario, run = rows["scenario"].to_numpy()[drawn], rows["run"].to_numpy()[drawn]
    assert drawn.shape == (200, 60)
    assert np.all((scenario == "s").sum(axis=1) == 20)
    # Four resampled runs of a scenario, each with all its episodes; most of 200 resamples miss a run.
    for one in drawn[:20]:
        times = pd.Series(run[0]).groupby(scenario[0]).value_counts()
        assert set(times["s"]) <= {5, 10, 15, 20}
        assert len(np.unique(one)) < 60
    missing = np.mean([len(set(run[i][scenario[i] == "t"])) < 4 for i in range(200)])
    assert missing == pytest.approx(1 - 24 / 256, abs=0.06)
    assert np.array_equal(drawn, bootstrap_positions(rows, seed=3, resamples=200))
    assert not np.array_equal(drawn, bootstrap_positions(rows, seed=4, resamples=200))


def test_runs_of_different_length_are_padded():
    rows = flights(np.arange(7.0), run=[0, 0, 0, 0, 0, 1, 1])
    drawn = bootstrap_positions(rows, resamples=300)
    lengths = (drawn >= 0).sum(axis=1)
    assert drawn.shape == (300, 10)
    assert set(lengths) == {4, 7, 10}
    assert np.all((drawn < 5).sum(axis=1) - (drawn < 0).sum(axis=1) == 5 * (lengths - 4) / 3)


def test_an_interval_contains_the_estimate_and_shrinks():
    widths = []
    for n in (20, 80, 320, 1280):
        gap = np.random.default_rng(n).exponential(0.05, n)
        gap[::10] = np.nan
        row = summary(flights(gap)).iloc[0]
        assert row.gap_low < row.gap < row.gap_high
        assert row.success_low < row.success_rate == 0.9 < row.success_high
        assert row.episodes == n
        widths.append([row.gap_high - row.gap_low, row.success_high - row.success_low])
    assert np.all(np.diff(widths, axis=0) < 0)
    assert widths[0][1] / widths[-1][1] == pytest.approx(8, rel=0.35)


def test_stratified_intervals_are_narrower_if_scenarios_differ(generator):
    gap = np.concatenate([generator.normal(mu, 0.01, 50) for mu in (0.1, 0.5, 0.9)])
    rows = flights(gap, scenario=np.repeat(["s", "t", "u"], 50))
    apart, mixed = (summary(table, by=("agent",)).iloc[0] for table in (rows, rows.assign(scenario="s")))
    assert apart.gap == mixed.gap
    assert apart.gap_high - apart.gap_low < 0.3 * (mixed.gap_high - mixed.gap_low)


def test_few_runs_make_an_interval_wide_for_any_number_of_episodes(generator):
    gap = np.repeat([0.02, 0.05, 0.08], 200) + generator.normal(0, 0.001, 600)
    rows = flights(gap, run=np.repeat([0, 1, 2], 200))
    apart, pooled = summary(rows).iloc[0], summary(rows.drop(columns="run")).iloc[0]
    assert (apart.runs, pooled.runs) == (3, 1)
    assert apart.gap_high - apart.gap_low > 5 * (pooled.gap_high - pooled.gap_low)


def test_constant_data_give_a_point_interval():
    row = summary(flights(np.full(30, 0.07))).iloc[0]
    assert row.gap_low == pytest.approx(0.07, rel=1e-14)
    assert row.gap_high == pytest.approx(0.07, rel=1e-14)
    assert (row.success_low, row.success_rate, row.success_high) == (1, 1, 1)


def test_without_successes_there_is_no_gap():
    row = summary(flights(np.full(8, np.nan))).iloc[0]
    assert (row.success_low, row.success_rate, row.success_high) == (0, 0, 0)
    assert np.isnan([row.steps, row.gap, row.gap_low, row.gap_high]).all()


def test_groups_keep_their_order_and_are_independent(generator):
    gap = generator.exponential(0.1, 40)
    rows = flights(gap, agent=np.repeat(["z", "a"], 20))
    table = summary(rows)
    assert table["agent"].tolist() == ["z", "a"]
    alone = summary(rows[rows["agent"] == "a"])
    pd.testing.assert_series_equal(table.iloc[1], alone.iloc[0], check_names=False)


def test_intervals_have_their_nominal_coverage():
    """Of 300 samples of 60 normal values, about 95 % have a 95 % interval that contains the mean."""
    generator, held = np.random.default_rng(5), 0
    for trial in range(300):
        values = generator.normal(0.3, 1, 60)
        low, high = interval(values, bootstrap_positions(flights(values), seed=trial, resamples=400))
        held += low < 0.3 < high
    assert 0.90 <= held / 300 <= 0.98


def test_rows_without_the_scored_columns_are_refused():
    with pytest.raises(ValueError, match="columns gap"):
        summary(flights([0.1]).drop(columns="gap"))
    with pytest.raises(ValueError, match="columns colour"):
        summary(flights([0.1]), by=("colour",))
    with pytest.raises(ValueError, match="got 0 rows"):
        summary(flights([]))
