"""Gaps by work: monotone in the work, infinite without success, and the median of the runs."""

from math import inf

import pytest

from agents.evaluation.validation import best_of, milestones
from experiments.benchmark.summary import TARGET_SUCCESS, samples_to_target
from experiments.benchmark.work import SAMPLES, SECONDS, gap_within, gaps_by_work, median_gap


def run(*points):
    """A run whose validations have (env steps, expert labels, seconds, success rate, steps)."""
    keys = ("env_steps", "expert_labels", "wall_time_s", "success_rate", "steps")
    return {"curve": [dict(zip(keys, point, strict=True)) for point in points]}


FAST = run((5e4, 1e4, 10, 1.0, 90), (5e5, 1e4, 100, 1.0, 72), (5e6, 1e4, 800, 1.0, 75))
SLOW = run((5e4, 0, 50, 0.5, 60), (2e6, 0, 300, 0.9, 84))
NEVER = run((5e6, 0, 900, 0.0, 75))


def test_the_gap_is_the_smallest_of_successful_validations_within_the_work():
    assert gap_within(FAST, 60, "samples", 6e4) == pytest.approx(0.5)
    assert gap_within(FAST, 60, "samples", 6e4 - 1) == inf
    assert gap_within(FAST, 60, "samples", 1e7) == pytest.approx(0.2)
    assert gap_within(SLOW, 60, "seconds", 299) == inf
    assert gap_within(SLOW, 60, "seconds", 300) == pytest.approx(0.4)


@pytest.mark.parametrize("cell", [FAST, SLOW, NEVER])
def test_more_work_never_widens_the_gap(cell):
    gaps = gaps_by_work([cell], 60)
    for part in (gaps[: len(SAMPLES)], gaps[len(SAMPLES) :]):
        assert part == sorted(part, reverse=True)
    assert len(gaps) == len(SAMPLES) + len(SECONDS)


def test_half_of_the_runs_must_succeed():
    assert median_gap([FAST, SLOW, NEVER], 60, "samples", 1e7) == pytest.approx(0.4)
    assert median_gap([FAST, NEVER, NEVER], 60, "samples", 1e7) == inf


@pytest.mark.parametrize("cell", [FAST, SLOW, NEVER])
def test_milestones_keep_every_statistic(cell):
    repeated = [dict(point) for point in cell["curve"] for _ in range(3)]
    dense = {"curve": run((1e3, 0, 1, 0.0, 90))["curve"] + repeated}
    kept = {"curve": milestones(dense["curve"], TARGET_SUCCESS)}
    assert len(kept["curve"]) < len(dense["curve"])
    assert gaps_by_work([kept], 60) == gaps_by_work([dense], 60)
    assert best_of(kept["curve"]) == best_of(dense["curve"])
    assert kept["curve"][-1] == dense["curve"][-1]
    assert samples_to_target(kept, 70) == pytest.approx(samples_to_target(dense, 70), nan_ok=True)
    assert milestones(kept["curve"], TARGET_SUCCESS) == kept["curve"]
