"""The environments' benchmark at small size: every section runs, and its ratios are those of the rounds."""

import json
import statistics

import numpy as np
import pytest

from experiments.files import SCHEMA
from experiments.measurements import environments
from experiments.measurements.environments import DRAWN, OURS, PEER, SECTIONS, judged, main, measured, resident
from experiments.measurements.interleaved import Candidate, batch, interleaved, rate, ratio, single
from flatgym import SCENARIOS


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    out = tmp_path_factory.mktemp("envs") / "envs.json"
    main(["--quick", "--out", str(out)])
    return json.loads(out.read_text())


@pytest.fixture(scope="module")
def rows(results):
    return {name: section["rows"] for name, section in results["sections"].items()}


def test_every_section_has_rows_and_the_file_says_how_they_came_about(results):
    assert results["schema"] == SCHEMA
    assert results["quick"] is True
    assert {"versions", "machine"} <= set(results)
    assert list(results["sections"]) == list(SECTIONS)
    for section in results["sections"].values():
        assert section["command"].startswith("python -m experiments.measurements.environments --quick")
        assert {"wall_time_s", "date"} <= set(section)
        assert section["rows"]


def test_speeds_are_medians_and_ratios_are_paired(rows):
    for name in ("batched", "scalar", "sb3", "ppo"):
        for row in rows[name]:
            assert row["steps_per_s"] == statistics.median(row["rates"]) > 0
            assert row["cores"] > 0
    for name in ("scalar", "sb3"):
        peer, ours = rows[name]
        assert peer["ratio"] == 1
        assert ours["ratio"] == statistics.median(np.divide(ours["rates"], peer["rates"]))


def test_bars_are_judged(rows):
    bars = {name: [row["bar"] for row in section if "bar" in row] for name, section in rows.items()}
    expected = {
        "batched": [1.5, 0.7],
        "scalar": [0.6],
        "imports": [0.35, 0],
        "sb3": [20],
        "ppo": [1.5],
        "memory": [1, 1],
    }
    assert bars == expected
    for section, judge in [(name, np.greater_equal) for name in ("batched", "scalar", "sb3", "ppo")] + [
        (name, np.less_equal) for name in ("imports", "memory")
    ]:
        for row in rows[section]:
            assert "bar" not in row or row["met"] == judge(row[row["bar_on"]], row["bar"])
    assert judged({"ratio": 2.0}, "ratio", 3.0)["met"] is False
    assert judged({"seconds": 2.0}, "seconds", 3.0, most=True)["met"] is True


def test_all_scenarios_are_timed_batched_and_numba_kept_out_once(rows):
    peer, hoop, *others = [row for row in rows["batched"] if "numba" not in row]
    assert (peer["what"], hoop["what"]) == (PEER, "hoop")
    assert [row["what"] for row in others[: len(DRAWN)]] == list(DRAWN)
    assert {row["what"] for row in [hoop, *others]} == {*SCENARIOS, *DRAWN}
    assert all(row["ratio_to_hoop"] == pytest.approx(ratio(row, hoop)) for row in others)
    assert [row["num_envs"] for row in others[-2:]] == [1, 16]
    assert [row["what"] for row in rows["batched"] if "numba" in row] == [PEER, "hoop"]


def test_what_was_compiled_is_found_on_disk(rows):
    *_, flatgym, cold, warm = rows["imports"]
    assert flatgym["what"] == "import flatgym"
    assert cold["compiled"] > 0 == warm["compiled"]
    assert warm["median_s"] < cold["median_s"]


def test_both_learn_from_as_many_steps(rows):
    peer, ours, *default = rows["ppo"]
    assert (peer["rollout"], peer["minibatch"]) == (ours["rollout"], ours["minibatch"])
    assert [row["minibatch"] for row in default] == [16, 16]


def test_memory_is_told_from_before_the_first_step_to_the_last(rows):
    for row in rows["memory"]:
        steps = [checkpoint["env_steps"] for checkpoint in row["checkpoints"]]
        assert steps[0] == 0
        assert steps == sorted(steps)
        assert steps[-1] >= 20_000


def test_a_leak_is_found():
    kept = []

    def play():
        kept.append(np.ones(1_000_000))
        return 1

    first, *_, last = measured(Candidate("leak", 1, play), [2, 10])
    assert last["env_steps"] == 10
    assert last["resident_mb"] - first["resident_mb"] > 40 * environments.FLAT


def test_without_proc_the_peak_is_told(monkeypatch):
    now = resident()
    monkeypatch.setattr(environments.Path, "read_text", lambda *_, **__: (_ for _ in ()).throw(FileNotFoundError()))
    assert resident() > 0.9 * now


def test_turns_are_taken_in_alternating_order_and_the_first_calls_are_not_timed():
    called = []

    def player(name, steps):
        return Candidate(name, 1, lambda: called.append(name) or steps)

    first, second = interleaved([player("a", 1), player("b", 1_000_000)], rounds=3, seconds=0.0)
    assert called == list("ab" + "ab" + "ba" + "ab")
    assert first["ratio"] == 1
    assert second["ratio"] > 1000
    assert len(second["rates"]) == 3


def test_a_rate_counts_steps_in_the_time_they_took():
    steps_per_s, cores = rate(lambda: sum(range(100_000)) and 7, seconds=0.05)
    assert steps_per_s > 0
    assert 0 < cores < 1.5


def test_players_say_how_many_steps_they_played():
    assert batch("hoop", 3, id=OURS, scenario="hoop").play() == 3 * 32
    assert single("hoop", id=OURS, scenario="hoop").play() == 32**2
