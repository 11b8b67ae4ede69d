"""Events within a step, compared with brute force on a fine grid of the same arc."""

import numpy as np

from flatgym.arc import Arc


def arcs(generator, quadrotor, n=1000, dt=0.1):
    state = generator.normal(0, [0.3, 0.3, 3, 3, 1.5], (n, 5))
    control = generator.uniform(quadrotor.control_low, quadrotor.control_high, (n, 2))
    return Arc(quadrotor, state, control, dt)


def dense(arc, count=4001):
    times = np.linspace(0, arc.dt[0], count)
    return times, np.stack([arc.at(t)[:, 0:2] for t in times], axis=1)


def test_crossings_are_found_on_the_arc(generator, quadrotor):
    arc = arcs(generator, quadrotor)
    angle = generator.uniform(0, 2 * np.pi, len(arc))
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    point = generator.normal(0, 0.3, (len(arc), 2))
    found = arc.crossing(point, direction, np.zeros(len(arc)))
    times, positions = dense(arc)
    along = np.sum((positions - point[:, None]) * direction[:, None], axis=-1)
    rises = (along[:, :-1] < 0) & (along[:, 1:] >= 0)
    expected = np.where(rises.any(axis=1), times[1:][np.argmax(rises, axis=1)], np.nan)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    assert np.isfinite(found).sum() > 60
    crossed = ~np.isnan(found)
    assert np.all(np.abs(found - expected)[crossed] <= times[1])
    at_root = np.sum((arc.at(np.nan_to_num(found))[:, 0:2] - point) * direction, axis=-1)[crossed]
    assert np.all((at_root >= 0) & (at_root < 1e-9))


def test_a_line_touched_twice_within_a_step_is_crossed(quadrotor):
    # Thrown upwards under low thrust the vehicle rises through the line and falls back.
    arc = Arc(quadrotor, np.array([[0, 0, 0, 0.5, 0.0]]), np.array([[1.0, 0.0]]), 0.2)
    when = arc.crossing(np.array([[0, 0.01]]), np.array([[0, 1.0]]), np.zeros(1))
    assert arc.at(0.2)[0, 1] < 0.01
    assert 0 < when[0] < 0.05


def test_lowest_point_and_closest_approach(generator, quadrotor):
    arc = arcs(generator, quadrotor)
    _, positions = dense(arc)
    low = positions[:, :, 1].min(axis=1)
    exact = arc.lowest(np.array([0.0, 1.0]))
    assert np.all((exact <= low + 1e-12) & (exact >= low - 1e-6))
    point = generator.normal(0, 0.2, (len(arc), 2))
    near = np.hypot(*(positions - point[:, None]).transpose(2, 0, 1)).min(axis=1)
    exact = arc.distance(point)
    assert np.all((exact <= near + 1e-12) & (exact >= near - 1e-3))


def test_reach_bounds_the_distance_travelled(generator, quadrotor):
    arc = arcs(generator, quadrotor)
    _, positions = dense(arc, 101)
    travelled = np.hypot(*(positions - positions[:, :1]).transpose(2, 0, 1)).max(axis=1)
    assert np.all(travelled <= arc.reach)


def test_closest_approaches_are_found_on_long_steps(generator, quadrotor):
    # Two closest approaches within one step, and points the vehicle circles or stays with.
    arc = arcs(generator, quadrotor, n=500, dt=0.5)
    point = generator.normal(0, 1.0, (len(arc), 2))
    _, positions = dense(arc, 8001)
    near = np.hypot(*(positions - point[:, None]).transpose(2, 0, 1)).min(axis=1)
    found = arc.distance(point)
    assert np.all((found <= near + 1e-12) & (found >= near - 1e-4))
    hover = Arc(quadrotor, np.zeros((2, 5)), np.array([[9.81, 0.0], [9.81, 1e-6]]), 0.1)
    np.testing.assert_allclose(hover.distance(np.array([[0.3, 0.4], [0.0, 0.0]])), [0.5, 0.0], atol=1e-9)


def test_the_distance_of_a_hovering_vehicle_is_found_on_long_steps(quadrotor):
    for dt in (0.02, 10.0, 1e4):
        arc = Arc(quadrotor, np.zeros((2, 5)), np.array([[9.81, 0.0], [9.81, 1e-12]]), dt)
        point = np.array([[0.3, 0.4], [0.0, 0.1]])
        assert np.all(np.abs(arc.distance(point, within=0.5)[:1] - 0.5) <= 1e-9)
        assert np.all(arc.distance(point, within=0.01) >= 0.01)
