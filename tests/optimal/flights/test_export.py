"""Export: numbers round-trip to the bit, columns have units, invalid files and flights are rejected."""

import csv

import numpy as np
import pytest

import optimal
from flatgym import SCENARIOS
from optimal.direct.shooting import solve_winding
from optimal.flights.export import COLUMNS, FORMATS, load, save
from optimal.flights.trajectory import Samples, Trajectory


@pytest.fixture(scope="module")
def flight():
    return solve_winding(SCENARIOS["horizontal-3"], nodes=40).trajectory


@pytest.mark.parametrize("ending", FORMATS)
def test_round_trip_is_exact(flight, tmp_path, ending):
    samples = flight.sample(0.01)
    again = load(save(samples, tmp_path / f"flight{ending}"))
    for part in ("time", "state", "control"):
        np.testing.assert_array_equal(getattr(again, part), getattr(samples, part))
    assert [path.name for path in tmp_path.iterdir()] == [f"flight{ending}"]


def test_a_flight_is_restored_from_its_breakpoints(flight, tmp_path):
    controls = np.append(flight.controls, flight.controls[-1:], axis=0)
    held = load(save(Samples(flight.breakpoints, flight.states, controls), tmp_path / "flight.csv"))
    again = Trajectory(held.time, held.state, held.control[:-1], flight.quadrotor)
    times = np.linspace(0, flight.duration, 333)
    np.testing.assert_array_equal(again.state(times), flight.state(times))
    assert optimal.certify(again, SCENARIOS["horizontal-3"]).holds()


def test_columns_have_units(flight, tmp_path):
    lines = list(csv.reader(save(flight.sample(0.1), tmp_path / "flight.csv").read_text().splitlines()))
    assert tuple(lines[0]) == COLUMNS
    assert float(lines[-1][0]) == flight.duration


def test_a_failed_write_keeps_the_old_file(flight, tmp_path):
    samples = flight.sample(0.1)
    path = save(samples, tmp_path / "flight.csv")
    before = path.read_text()
    with pytest.raises(ValueError, match="must be finite"):
        save(Samples(samples.time, samples.state * np.nan, samples.control), path)
    assert path.read_text() == before


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("flight.txt", "", r"unknown ending '\.txt' of flight\.txt; known: \.csv, \.json, \.npz"),
        ("flight.csv", "t_s,x_m\n0,1\n", "does not hold the columns"),
        ("flight.json", "[1, 2", "does not hold the columns"),
        ("flight.json", "[1, 2]", "does not hold the columns"),
        ("flight.npz", "PK no archive", "does not hold the columns"),
        ("flight.csv", ",".join(COLUMNS) + "\n" + ",".join(["nan"] * 8) + "\n", "finite numbers"),
        ("flight.csv", ",".join(COLUMNS) + "\n", "at least one row"),
    ],
)
def test_a_file_without_a_flight_is_rejected(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(ValueError, match=words):
        load(path)
