"""Export: numbers round-trip to the bit, columns have units, invalid files and flights are rejected."""

import csv

import numpy as np
import pytest

import optimal
from flatgym import SCENARIOS
from flatgym.quadrotor import nearest_turn
from optimal.direct.shooting import solve_winding
from optimal.discrete.fewest_steps import FewestSteps
from optimal.flights.export import COLUMNS, FORMATS, HELD_COLUMNS, load, save
from optimal.flights.solution import Status
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


@pytest.mark.parametrize("ending", FORMATS)
def test_a_flight_is_restored_from_its_breakpoints(flight, tmp_path, ending):
    held = load(save(flight, tmp_path / f"flight{ending}"))
    assert held.held
    again = Trajectory(held.time, held.state, held.control[:-1], flight.quadrotor)
    times = np.linspace(0, flight.duration, 333)
    np.testing.assert_array_equal(again.state(times), flight.state(times))
    assert optimal.certify(again, SCENARIOS["horizontal-3"]).holds()


def flown(samples, scenario):
    """Return the states of a vehicle that holds the control of each row to the next."""
    return scenario.quadrotor.fly(scenario.start_state, samples.control[:-1], np.diff(samples.time))


def test_held_controls_fly_again_and_a_sampled_reference_does_not(flight, tmp_path):
    scenario = SCENARIOS["horizontal-3"]
    held, sampled = load(save(flight, tmp_path / "held.csv")), load(save(flight.sample(0.1), tmp_path / "sampled.csv"))
    assert held.held
    assert not sampled.held
    np.testing.assert_allclose(flown(held, scenario)[-1], scenario.goal_state, atol=1e-6)
    assert np.abs(flown(sampled, scenario)[-1] - scenario.goal_state).max() > 0.05


@pytest.mark.parametrize("name", ["horizontal-3", "hoop"])
def test_the_fewest_steps_fly_from_their_file_to_the_goal(name, tmp_path):
    best = optimal.fewest_steps(name, time_budget=0)
    scenario = best.scenario
    file = load(save(best, tmp_path / "steps.json"))
    assert file.held
    assert len(file.time) == best.steps + 1
    np.testing.assert_allclose(np.diff(file.time), scenario.dt, rtol=1e-12)
    states = flown(file, scenario)
    np.testing.assert_allclose(states, file.state, atol=1e-12)
    error, tolerance = states[-1] - scenario.goal_state, scenario.tolerance
    assert np.hypot(*error[0:2]) <= tolerance.position
    assert np.hypot(*error[2:4]) <= tolerance.speed
    assert abs(nearest_turn(error[4])) <= tolerance.angle


def test_a_flight_without_held_controls_is_refused(tmp_path):
    indirect = optimal.solve("horizontal-3", "pontryagin", max_gap=None)
    with pytest.raises(ValueError, match=r"ExtremalFlight are not held.*flight\.sample\(dt\)"):
        save(indirect, tmp_path / "flight.csv")
    nothing = FewestSteps.failed(SCENARIOS["hoop"], Status.NO_STEPS_FOUND)
    with pytest.raises(ValueError, match="no flight in this answer; see its status"):
        save(nothing, tmp_path / "flight.csv")
    assert not list(tmp_path.iterdir())


def test_columns_have_units_and_tell_held_controls(flight, tmp_path):
    for samples, columns in ((flight.sample(0.1), COLUMNS), (flight, HELD_COLUMNS)):
        lines = list(csv.reader(save(samples, tmp_path / "flight.csv").read_text().splitlines()))
        assert tuple(lines[0]) == columns
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
