"""The measurement of the chain bound at small size: bounds below flights, and totals that agree with their rows."""

import pytest

from experiments.measurements import tracks
from flatgym import SCENARIOS
from optimal import prove


@pytest.fixture
def rows(results):
    """The rows of each section."""
    return {name: section["rows"] for name, section in results["sections"].items()}


def test_smaller_gaps_raise_the_bound(rows):
    found = rows["convergence"]
    assert [row["gap_asked"] for row in found] == list(tracks.GAPS[: len(found)])
    for row in found:
        assert row["checked"]
        assert 0 < row["gap"] <= row["gap_asked"]
    bounds = [row["lower_bound_s"] for row in found]
    assert bounds == sorted(bounds)


def test_a_scenario_ends_with_the_first_proof_that_spends_its_budget(monkeypatch):
    spent = prove("hoop", max_gap=1e-9, time_budget=0.2)
    monkeypatch.setattr(tracks, "prove", lambda *_, **__: spent)
    assert len(tracks.convergence(True, lambda *_: None)) == 1


def test_bounds_of_slaloms_are_proven_below_certified_flights(rows):
    assert [row["hoops"] for row in rows["hoops"]] == [1, 2]
    for row in rows["hoops"]:
        assert row["checked"]
        assert row["lower_bound_s"] < row["certified_s"]
        assert row["gap"] <= row["gap_asked"]


def test_the_slalom_of_three_hoops_is_the_named_one():
    assert tracks.slalom(3).hoops == SCENARIOS["slalom"].hoops
    assert tracks.slalom(3).goal == SCENARIOS["slalom"].goal


def test_the_total_of_the_sampled_tracks_is_that_of_their_rows(rows):
    *each, total = rows["random_tracks"]
    assert total["tracks"] == total["checked"] == total["certified"] == len(each)
    assert total["gap_worst"] == max(row["gap"] for row in each)
    assert all(row["lower_bound_s"] < row["certified_s"] for row in each)
    assert all(4 <= row["hoops"] <= 8 for row in each)


def test_no_bound_is_above_a_flight_and_no_longer_time_is_excluded(rows):
    assert [row["limits"] for row in rows["track_validity"]] == list(tracks.VEHICLES)
    for row in rows["track_validity"]:
        assert row["checked"] == row["certified"] == row["tracks"] > 0
        assert row["above_a_flight"] == row["slower_excluded"] == 0
        assert row["evaluations"] > 0
        assert row["least_gap"] > 0


def test_a_shorter_time_would_be_excluded(monkeypatch):
    monkeypatch.setattr(tracks, "SLOWER", 0.98)
    assert tracks.bound_and_track("", tracks.slalom(1), 20.0)["slower_excluded"]


def test_draws_of_the_table_are_counted(rows):
    for row in rows["sampled_steps"]:
        assert row["proven"] + len(row["open_seeds"]) == row["draws"]
        assert (row["gap_steps_worst"] == 0) == (not row["open_seeds"])
