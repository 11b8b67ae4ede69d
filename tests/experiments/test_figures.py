"""Figures show the numbers they are given."""

import numpy as np
import pytest

from experiments import figures
from experiments.figures import Track
from flatgym import SCENARIOS


@pytest.fixture
def track():
    time = np.linspace(0, 1, 11)
    state = np.stack([6 * time, np.sin(time), 6 + 0 * time, np.cos(time), 0.3 * time], axis=-1)
    return Track("a flight", time, state, np.tile([9.81, 0.3], (11, 1)))


def test_paths_hold_the_flight_and_the_vehicles_on_it(track):
    figure = figures.paths(SCENARIOS["slalom"], [track], "title", vehicles=5)
    traces = {trace.name: trace for trace in figure.data}
    np.testing.assert_array_equal(traces["a flight"].x, track.state[:, 0])
    lifts = len(np.flatnonzero(np.isnan(figures.vehicle(track.state[0])[:, 0])))
    assert np.isnan(np.array(traces["vehicle"].x, dtype=float)).sum() == 5 * lifts
    assert figure.layout.yaxis.scaleanchor == "x"  # metres look the same in both directions
    assert sum(trace.name == "hoop" for trace in figure.data) == 2 * len(SCENARIOS["slalom"].hoops)


def test_each_flight_has_its_own_panel_on_the_same_scale(track):
    figure = figures.paths(SCENARIOS["horizontal-6"], [track, track], "title")
    assert figure.layout.yaxis.range == figure.layout.yaxis2.range
    assert figure.layout.yaxis2.scaleanchor == "x2"


def test_the_drawn_vehicle_stands_across_its_thrust(generator):
    for theta in generator.uniform(-7, 7, 5):
        state = np.array([1.0, 2.0, 0, 0, theta])
        outline, thrust = figures.vehicle(state), figures.thrust_line(state, 20.0)
        arm, axis = outline[1] - outline[0], thrust[1] - thrust[0]
        assert abs(arm @ axis) < 1e-12
        np.testing.assert_allclose(axis / np.hypot(*axis), [np.sin(theta), np.cos(theta)], atol=1e-12)
        np.testing.assert_allclose((outline[0] + outline[1]) / 2, [1.0, 2.0])


def test_floor_is_drawn(track):
    shapes = figures.paths(SCENARIOS["ground-6"], [track], "title").layout.shapes
    assert any(shape.y0 == shape.y1 == 0.0 for shape in shapes)


def test_controls_are_held_and_limits_drawn(track, quadrotor):
    figure = figures.controls(quadrotor, [track], "title")
    assert all(trace.line.shape == "hv" for trace in figure.data)
    assert {shape.y0 for shape in figure.layout.shapes} == {1.0, 20.0, -10.0, 10.0}


def test_a_learning_curve_separates_successes_from_failures():
    curve = [
        {"env_steps": 10, "outcome": "time-limit", "steps": 250},
        {"env_steps": 20, "outcome": "goal", "steps": 90},
        {"env_steps": 30, "outcome": "goal", "steps": 66},
    ]
    failed, flown = figures.learning(curve, 61, "title").data
    assert list(failed.x) == [10]
    assert list(flown.y) == [90, 66]


def test_written_pages_share_one_script(track, tmp_path, quadrotor):
    for name in ("one", "two"):
        figures.write_page(figures.controls(quadrotor, [track], name), tmp_path / f"{name}.html")
    assert {path.name for path in tmp_path.iterdir()} == {"one.html", "two.html", "plotly.min.js"}
    assert 'src="plotly.min.js"' in (tmp_path / "one.html").read_text()
    assert (tmp_path / "one.html").stat().st_size < 100_000
