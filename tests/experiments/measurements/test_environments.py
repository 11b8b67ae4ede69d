"""The measurement of the environments at small size: every section runs, and ratios are those of the rounds."""

import json
import statistics

import numpy as np
import pytest
from typer.testing import CliRunner

from experiments.cli import app
from experiments.files import SCHEMA
from experiments.measurements.environments import BASELINE, DRAWN, OURS, SECTIONS, with_target
from experiments.measurements.interleaved import Candidate, batch, interleaved, rate, ratio, single
from flatgym import SCENARIOS


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    out = tmp_path_factory.mktemp("envs") / "envs.json"
    CliRunner().invoke(app.app, ["measure", "environments", "--quick", "--out", str(out)], catch_exceptions=False)
    return json.loads(out.read_text())


@pytest.fixture(scope="module")
def rows(results):
    return {name: section["rows"] for name, section in results["sections"].items()}


def test_every_section_has_rows_and_provenance(results):
    assert results["schema"] == SCHEMA
    assert results["smoke"] is True
    assert {"versions", "machine", "processor", "commit"} <= set(results)
    assert list(results["sections"]) == list(SECTIONS)
    for section in results["sections"].values():
        assert {"wall_time_s", "date", "command", "commit"} <= set(section)
        assert section["rows"]


def test_speeds_are_medians_and_ratios_are_paired(rows):
    for name in ("batched", "scalar", "sb3", "ppo"):
        for row in rows[name]:
            assert row["steps_per_s"] == statistics.median(row["rates"]) > 0
            assert row["cores"] > 0
    for name in ("scalar", "sb3"):
        baseline, ours = rows[name]
        assert baseline["ratio"] == 1
        assert ours["ratio"] == statistics.median(np.divide(ours["rates"], baseline["rates"]))


def test_targets_are_checked(rows):
    targets = {name: [row["target"] for row in section if "target" in row] for name, section in rows.items()}
    expected = {
        "batched": [1.5, 0.7],
        "scalar": [0.6],
        "imports": [0.35, 0],
        "sb3": [20],
        "ppo": [1.5],
        "memory": [1, 1],
        "libraries": [1e6],
        "agreement": [1.0, 1.0],
    }
    assert targets == expected
    for section, passes in [(name, np.greater_equal) for name in ("batched", "scalar", "sb3", "ppo", "libraries")] + [
        (name, np.less_equal) for name in ("imports", "memory")
    ]:
        for row in rows[section]:
            assert "target" not in row or row["passed"] == passes(row[row["metric"]], row["target"])
    assert with_target({"ratio": 2.0}, "ratio", 3.0)["passed"] is False
    assert with_target({"seconds": 2.0}, "seconds", 3.0, at_most=True)["passed"] is True


def test_all_scenarios_are_timed_batched_and_numba_kept_out_once(rows):
    baseline, hoop, *others = [row for row in rows["batched"] if "numba" not in row]
    assert (baseline["what"], hoop["what"]) == (BASELINE, "hoop")
    assert [row["what"] for row in others[: len(DRAWN)]] == list(DRAWN)
    assert {row["what"] for row in [hoop, *others]} == {*SCENARIOS, *DRAWN}
    assert all(row["ratio_to_hoop"] == pytest.approx(ratio(row, hoop)) for row in others)
    assert [row["num_envs"] for row in others[-2:]] == [1, 16]
    assert [row["what"] for row in rows["batched"] if "numba" in row] == [BASELINE, "hoop"]


def test_what_was_compiled_is_found_on_disk(rows):
    *_, flatgym, cold, warm = rows["imports"]
    assert flatgym["what"] == "import flatgym"
    assert cold["compiled"] > 0 == warm["compiled"]
    assert warm["median_s"] < cold["median_s"]


def test_both_learn_from_as_many_steps(rows):
    baseline, ours, *default = rows["ppo"]
    assert (baseline["rollout"], baseline["minibatch"]) == (ours["rollout"], ours["minibatch"])
    assert [row["minibatch"] for row in default] == [16, 16]


def test_the_libraries_are_timed_beside_the_kernels_and_fly_as_numpy(rows):
    kernels, torch, jax = rows["libraries"]
    assert (kernels["what"], torch["what"], jax["what"]) == ("hoop", "PyTorch, float32 of hoop", "JAX, float32 of hoop")
    for row in rows["agreement"]:
        assert row["passed"]
        assert (row["same"], row["differing"]) == (row["episodes"], [])
        assert row["max_error"] <= 1e-10


def test_memory_is_recorded_from_before_the_first_step_to_the_last(rows):
    for row in rows["memory"]:
        steps = [checkpoint["env_steps"] for checkpoint in row["checkpoints"]]
        assert steps[0] == 0
        assert steps == sorted(steps)
        assert steps[-1] >= 4_000


def test_the_order_alternates_and_the_first_calls_are_not_timed():
    called = []

    def candidate(name, steps):
        return Candidate(name, 1, lambda: called.append(name) or steps)

    first, second = interleaved([candidate("a", 1), candidate("b", 1_000_000)], rounds=3, seconds=0.0)
    assert called == list("ab" + "ab" + "ba" + "ab")
    assert first["ratio"] == 1
    assert second["ratio"] > 1000
    assert len(second["rates"]) == 3


def test_a_rate_counts_steps_in_the_time_they_took():
    steps_per_s, cores = rate(lambda: sum(range(100_000)) and 7, seconds=0.05)
    assert steps_per_s > 0
    assert 0 < cores < 1.5


def test_candidates_return_their_number_of_steps():
    assert batch("hoop", 3, id=OURS, scenario="hoop").play() == 3 * 32
    assert single("hoop", id=OURS, scenario="hoop").play() == 32**2
