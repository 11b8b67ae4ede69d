"""The table of best-known solutions is reproduced, and refuses a K* that differs from the published one."""

import json

import numpy as np
import pytest

from experiments.measurements import reference_table as writer
from flatgym.scenarios.reference import FILE, SCHEMA, drawn_k_star, reference
from optimal import FewestSteps, Status


def test_a_row_is_computed_as_it_stands(tmp_path):
    writer.write_table(tmp_path / FILE, ["horizontal-3"])
    written = json.loads((tmp_path / FILE).read_text())
    (row,) = written["references"]
    assert written["schema"] == SCHEMA
    assert written["machine"]["cores"] >= 1
    assert np.array_equal(np.array(row["actions"], dtype=np.float32), reference("horizontal-3").actions)


def test_another_k_star_is_refused(monkeypatch):
    wrong = {"scenario": "horizontal-3", "k_star": 43}
    monkeypatch.setattr(writer, "_published", lambda *_: wrong)
    with pytest.raises(
        ValueError, match=r"horizontal-3: a flight in 44 steps was found, but solvers\.json has K\* = 43"
    ):
        writer.named_row("horizontal-3")


def test_sampled_k_star_are_the_shipped_ones_and_are_stored(tmp_path, monkeypatch):
    found = writer.sampled_k_star("random-goal", 2, store=tmp_path, jobs=1)
    known = drawn_k_star("random-goal", found["first_seed"] + np.arange(2))
    assert (found["k_star"], found["k_lower_bound"]) == (known.k_star.tolist(), known.k_lower_bound.tolist())
    monkeypatch.setattr("joblib.Parallel", None)
    assert writer.sampled_k_star("random-goal", 2, store=tmp_path, jobs=1) == found


def test_a_sampled_scenario_without_a_flight_is_named(monkeypatch):
    def nothing(scenarios, **_):
        return [FewestSteps.failed(scenario, Status.INTERRUPTED, "no power") for scenario in scenarios]

    monkeypatch.setattr(writer.optimal, "fewest_steps_many", nothing)
    with pytest.raises(ValueError, match="random-goal-1000000-0: no flight was found: no power"):
        writer.sampled_k_star("random-goal", 1)


def test_float32_numbers_read_back_exactly(generator):
    values = np.concatenate([generator.uniform(-1, 1, (500, 2)), [[0.0, -0.0], [1e-30, 1.0]]]).astype(np.float32)
    again = np.array(json.loads(json.dumps(writer.shortest_decimals(values))), dtype=np.float32)
    assert np.array_equal(again.view(np.uint32), values.view(np.uint32))
