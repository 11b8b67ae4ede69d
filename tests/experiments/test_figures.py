"""Figures show the numbers they are given."""

import re
from dataclasses import replace

import numpy as np
import pytest

import optimal
from experiments import figures
from experiments.figures import Track
from flatgym import SCENARIOS, Hoop
from optimal import Status


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


def heights_drawn(figure):
    """Return the heights of the lines of floor and ceiling that lie within the drawing."""
    low, high = figure.layout.yaxis.range
    return {shape.y0 for shape in figure.layout.shapes if shape.type == "line" and low < shape.y0 < high}


def test_floor_and_ceiling_are_drawn_within_the_picture(track):
    assert heights_drawn(figures.paths(SCENARIOS["ground-6"], [track], "title")) == {0.0}
    room = replace(SCENARIOS["ground-6"], floor=-2.0, ceiling=3.0)
    assert heights_drawn(figures.paths(room, [track], "title")) == {-2.0, 3.0}
    hall = replace(SCENARIOS["ground-6"], floor=-2.0, ceiling=40.0)  # would make the flight small
    assert heights_drawn(figures.paths(hall, [track], "title")) == {-2.0}


@pytest.mark.parametrize("angle", [0.0, 1.0, np.pi / 2, np.pi])
def test_hoops_are_drawn_whole(track, angle):
    wide = replace(SCENARIOS["horizontal-6"], hoops=(Hoop(1.0, 0.0, 5.0, angle), Hoop(6.5, 0.0, 1.0, angle)))
    figure = figures.paths(wide, [track], "title")
    (left, right), (bottom, top) = figure.layout.xaxis.range, figure.layout.yaxis.range
    posts = [trace for trace in figure.data if trace.name == "hoop"]
    assert len(posts) == 4
    for post in posts:
        assert left < min(post.x) <= max(post.x) < right
        assert bottom < min(post.y) <= max(post.y) < top


def test_only_a_proven_optimum_is_called_so():
    flown = optimal.solve("horizontal-3", max_gap=None)
    proven, feasible = (
        replace(flown, status=Status.OPTIMAL),
        replace(flown, status=Status.CERTIFIED, method="flat"),
    )
    bound = flown.certificate.lower_bound
    assert figures.optimal_track(proven).name == f"optimum, T* = {flown.time:.4f} s"
    for one, words in ((flown, "locally optimal"), (feasible, "not optimal")):
        name = figures.optimal_track(one).name
        assert name.startswith(f"{words}, T = {flown.time:.4f} s, T* ≥ ")
        assert bound - 1e-4 < float(name.split()[-2]) <= bound


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


def test_a_written_page_is_complete_in_one_file(track, tmp_path, quadrotor):
    chart = figures.controls(quadrotor, [track], "one")
    figures.write_page(chart, tmp_path / "new" / "one.html")
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["one.html"]
    assert not re.search(r"<script[^>]*src=", (tmp_path / "new" / "one.html").read_text())
    for ending in (".png", ".HTML", ""):
        with pytest.raises(ValueError, match=rf"unknown ending '{ending}' of race{ending}; known: \.html"):
            figures.write_page(chart, tmp_path / f"race{ending}")
    assert [path.name for path in tmp_path.iterdir()] == ["new"]
