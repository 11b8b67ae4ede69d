"""The table of the environments: comparisons, targets, and ratios rounded down."""

import re
from copy import deepcopy

import pytest

from experiments.files import published
from experiments.measurements.environments import SECTIONS
from experiments.publishing.environments import LINES, environments, many, rounded_down, speed, target_cells


@pytest.fixture
def results():
    """The published results, to be changed at will."""
    return deepcopy(published("envs.json"))


def lines(text):
    """Return the cells of the table below its head."""
    table = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("|")]
    return table[2:]


def timed(what, num_envs, steps_per_s, ratio, **others):
    """Return a row as the benchmark writes it."""
    row = {"what": what, "num_envs": num_envs, "steps_per_s": steps_per_s, "rates": [steps_per_s], "ratio": ratio}
    return row | {"cores": 1.0} | others


def test_every_target_is_shown_and_whether_it_is_passed(results):
    rows = [row for section in results["sections"].values() for row in section["rows"] if "target" in row]
    reported = [line[-2:] for line in lines(environments(results)) if line[-1] != "-"]
    assert sorted(reported) == sorted(map(target_cells, rows))
    for row in rows:
        row["passed"] = not row["passed"]
    turned = [line[-1] for line in lines(environments(results)) if line[-1] != "-"]
    assert turned == [{"yes": "no", "no": "yes"}[word] for _, word in reported]


def test_each_section_can_stand_alone(results):
    assert set(LINES) == set(SECTIONS) >= set(results["sections"])
    whole = lines(environments(results))
    parts = []
    for name in (name for name in LINES if name in results["sections"]):
        alone = results | {"sections": {name: results["sections"][name]}}
        parts += lines(environments(alone))
    assert parts == whole


def test_small_sizes_and_versions_are_stated(results):
    assert "the numbers mean nothing" not in environments(results)
    assert f"gymnasium {results['versions']['gymnasium']}" in " ".join(environments(results).split())
    assert "numbers mean nothing" in " ".join(environments(results | {"smoke": True}).split())


def test_dates_of_sections_run_on_other_days_are_stated(results):
    results["sections"]["scalar"]["date"] = "2001-02-03T00:00:00+00:00"
    assert re.search(r"2001-02-03 to \d{4}", " ".join(environments(results).split()))


def test_a_line_names_both_and_rounds_the_ratio_down():
    baseline = timed("CartPole-v1", 1, 62_000.0, 1.0)
    ours = timed("hoop", 1, 37_138.0, 0.5999, metric="ratio", target=0.6, passed=False)
    (line,) = LINES["scalar"]([baseline, ours])
    assert line == [
        "scalar, `gym.make`: `hoop`, against CartPole-v1", "37.1 k/s", "62.0 k/s", "0.59", "≥ 0.6", "no"
    ]  # fmt: skip


def test_the_slowest_other_scenario_is_the_slowest_of_as_many_vehicles():
    rows = [
        timed("CartPole-v1", 1024, 1e7, 1.0),
        timed("hoop", 4096, 2e7, 2.0, metric="ratio", target=1.5, passed=True),
        timed("random-hoops", 4096, 1.6e7, 1.6, ratio_to_hoop=0.8, metric="ratio_to_hoop", target=0.7, passed=True),
        timed("climb", 4096, 1.9e7, 1.9, ratio_to_hoop=0.95),
        timed("slalom", 4096, 1.8e7, 1.8, ratio_to_hoop=0.9),
        timed("hoop", 1, 5e4, 0.005, ratio_to_hoop=0.0025),
        timed("CartPole-v1", 1024, 1e7, 1.0, numba=False),
        timed("hoop", 4096, 5e5, 0.05, numba=False),
    ]
    reported = list(LINES["batched"](rows))
    assert [line[3] for line in reported] == ["2.00", "0.80", "0.90", "0.05"]
    assert "4,096 x `slalom`" in reported[2][0]
    assert reported[0] == [
        "batched: 4,096 x `hoop`, against 1,024 x CartPole-v1", "20.00 M/s", "10.00 M/s", "2.00", "≥ 1.5", "yes"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("ratio", "text"), [(1.4999, "1.49"), (0.7, "0.70"), (1.5, "1.50"), (35.9, "35"), (1e4, "10,000")]
)
def test_ratios_are_rounded_down(ratio, text):
    assert rounded_down(ratio) == text


def test_a_wrapper_is_named_before_the_number():
    assert many({"what": "hoop", "num_envs": 4096}) == "4,096 x `hoop`"
    assert many({"what": "DummyVecEnv of CartPole-v1", "num_envs": 1024}) == "DummyVecEnv of 1,024 x CartPole-v1"


def test_speeds_have_units():
    assert speed({"steps_per_s": 15_250_000.0}) == "15.25 M/s"
    assert speed({"steps_per_s": 41_234.0}) == "41.2 k/s"


def test_libraries_are_compared_with_the_kernels_and_errors_rounded_up():
    kernels = timed("hoop", 4096, 1e7, 1.0)
    jax = timed("JAX, float32 of hoop", 4096, 2e6, 0.2, metric="steps_per_s", target=1e6, passed=True)
    (line,) = LINES["libraries"]([kernels, jax])
    assert line[0] == "JAX, float32, one core: 4,096 x `hoop`, against the kernels"
    assert line[-3:] == ["0.20", "≥ 1,000,000/s", "yes"]
    row = {"what": "JAX", "precision": "float64", "env_steps": 1000, "max_error": 7.1e-15, "episodes": 9, "same": 9}
    (line,) = LINES["agreement"]([row])
    assert line[1] == "9 of 9 episodes alike, errors ≤ 8e-15"
