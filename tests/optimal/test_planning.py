"""Eq. (10): what is called solved is a flight, optimal to 0.3 %; what holds at nodes only is not."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flatgym.catalogue import SCENARIOS
from flatgym.quadrotor import Quadrotor
from optimal.flat_trajectory import FlatTrajectory
from optimal.paths import PolynomialPath, level_paths, paper_outer_paths
from optimal.planning import FlatSolution, plan

BEST = {"horizontal-3": 0.8987, "horizontal-6": 1.23132, "ground-6": 1.23408, "diagonal": 1.4112, "hoop": 1.41797}
"""Flight times of the direct method with the exact step [s]."""
INTERVALS = 48


@cache
def planned(name: str, checks: str = "certified") -> FlatSolution:
    paths, ends = paper_outer_paths(SCENARIOS[name])
    return plan(paths, ends=ends, intervals=INTERVALS, checks=checks)


def flown(name: str) -> FlatTrajectory:
    trajectory = planned(name).trajectory
    assert trajectory is not None
    return trajectory


def slow_central_flight(name: str) -> FlatTrajectory:
    (first, second), (start, end) = paper_outer_paths(SCENARIOS[name])
    nodes = np.array([0.0, 1.0])
    # One cubic from the first weight to the last, level at both, and a constant slow speed.
    weight = np.array([[start], [0.0], [3 * (end - start)], [-2 * (end - start)]])
    return FlatTrajectory(nodes, weight, np.array([[0.01], [0.0], [0.0]]), (first, second), Quadrotor())


@pytest.mark.parametrize(("name", "loss"), [("horizontal-3", 3e-3), ("ground-6", 3e-3), ("diagonal", 0.04)])
def test_certified_flights_are_near_the_best_and_never_below_it(name: str, loss: float) -> None:
    solution = planned(name)
    assert solution.converged, solution.status
    assert solution.violation <= 1e-6
    assert -1e-4 < solution.time / BEST[name] - 1 < loss
    assert solution.trajectory is not None
    assert solution.time == solution.trajectory.duration


@pytest.mark.parametrize("name", ["horizontal-3", "ground-6", "diagonal"])
def test_an_independent_dense_sampling_finds_no_violation(name: str) -> None:
    trajectory, vehicle = flown(name), Quadrotor()
    control = trajectory.control(np.linspace(0, trajectory.duration, 50_001))
    assert control[:, 0].max() <= vehicle.thrust_max * (1 + 1e-6)
    assert control[:, 0].min() >= vehicle.thrust_min * (1 - 1e-6)
    assert np.abs(control[:, 1]).max() <= vehicle.rate_max * (1 + 1e-6)


@pytest.mark.parametrize("name", ["horizontal-3", "ground-6"])
def test_limits_at_nodes_only_lie(name: str) -> None:
    lie = planned(name, "nodes")
    assert lie.converged
    assert lie.time < planned(name).time
    assert lie.violation > 1
    assert "not a flight" in lie.status


@pytest.mark.parametrize("name", ["horizontal-3", "ground-6", "diagonal"])
def test_flights_begin_and_end_at_rest_upright_and_in_place(name: str) -> None:
    trajectory, task = flown(name), SCENARIOS[name]
    np.testing.assert_allclose(trajectory.state(0.0), task.start_state, atol=1e-9)
    np.testing.assert_allclose(trajectory.state(trajectory.duration), task.goal_state, atol=1e-9)


def test_the_ground_is_never_touched_from_below() -> None:
    trajectory = flown("ground-6")
    assert trajectory(np.linspace(0, trajectory.duration, 20_001))[:, 1].min() >= -1e-12


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("name", ["horizontal-3", "diagonal"])
def test_each_order_is_the_time_derivative_of_the_one_before(name: str, order: int) -> None:
    trajectory, h = flown(name), 1e-6
    middles = (trajectory.breakpoints[1:] + trajectory.breakpoints[:-1]) / 2
    difference = (trajectory(middles + h, order - 1) - trajectory(middles - h, order - 1)) / (2 * h)
    exact = trajectory(middles, order)
    np.testing.assert_allclose(difference, exact, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("name", ["horizontal-3", "diagonal"])
def test_states_and_controls_obey_the_equations_of_motion(name: str) -> None:
    trajectory, vehicle = flown(name), Quadrotor()
    state, nodes = trajectory.state(0.0), trajectory.breakpoints
    # Interval by interval, because the rate may jump at a node.
    for begin, end in itertools.pairwise(nodes):
        inside = np.array([begin, end - 1e-13])

        def motion(t: float, x: np.ndarray, inside: np.ndarray = inside) -> np.ndarray:
            return vehicle.derivative(x, trajectory.control(np.clip(t, *inside)))

        state = solve_ivp(motion, (begin, end), state, method="DOP853", rtol=1e-8, atol=1e-9).y[:, -1]
    np.testing.assert_allclose(state, trajectory.state(trajectory.duration), atol=1e-6)


def test_the_length_flown_is_the_length_of_the_path() -> None:
    trajectory = flown("diagonal")
    path = trajectory.path(np.linspace(0, 1, 100_001))
    assert np.diff(path[:, 0]).min() >= -1e-12
    t = np.linspace(0, trajectory.duration, 100_001)
    flown_length = np.trapezoid(np.hypot(*trajectory(t, 1).T), t)
    assert flown_length == pytest.approx(np.hypot(*np.diff(path, axis=0).T).sum(), rel=1e-7)


def test_breakpoints_and_shapes() -> None:
    trajectory = flown("horizontal-3")
    assert trajectory.breakpoints.shape == (INTERVALS + 1,)
    assert trajectory.breakpoints[0] == 0
    assert np.all(np.diff(trajectory.breakpoints) > 0)
    t = np.linspace(0, trajectory.duration, 6).reshape(2, 3)
    assert trajectory(t, 2).shape == (2, 3, 2)
    assert trajectory.state(t).shape == (2, 3, 5)
    assert trajectory.control(0.1).shape == (2,)
    np.testing.assert_array_equal(trajectory.state(t)[1, 2], trajectory.state(t[1, 2]))


@pytest.mark.parametrize("name", ["horizontal-3", "horizontal-15", "ground-6", "diagonal", "hoop"])
def test_the_slow_central_start_is_feasible(name: str) -> None:
    assert slow_central_flight(name).violation() == 0


def test_a_constant_speed_takes_its_closed_form_time() -> None:
    assert slow_central_flight("diagonal").duration == pytest.approx(10.0, rel=1e-14)


@pytest.mark.parametrize("curvature", [-0.3, -1e-9, 0.0, 1e-9, 0.7])
def test_the_closed_form_time_agrees_with_quadrature(curvature: float) -> None:
    squared_speed = np.array([[0.2], [0.4], [curvature]])
    flat = slow_central_flight("horizontal-3")
    trajectory = FlatTrajectory(flat.nodes, flat.weight, squared_speed, flat.outer_paths, flat.quadrotor)
    u, w = np.polynomial.legendre.leggauss(60)
    s = (u + 1) / 2
    quadrature = float((w / 2 / np.sqrt(0.2 + 0.4 * s + curvature * s**2)).sum())
    assert trajectory.duration == pytest.approx(quadrature, rel=1e-12)


def test_mirrored_outer_paths_give_the_same_time() -> None:
    found = plan(level_paths((0, 0), -3.0, -1.0, 1.0), intervals=30)
    swapped = plan(level_paths((0, 0), 3.0, -1.0, 1.0)[::-1], intervals=30)
    straight = plan(level_paths((0, 0), 3.0, -1.0, 1.0), intervals=30)
    assert found.time == pytest.approx(straight.time, rel=1e-4)
    assert swapped.time == pytest.approx(straight.time, rel=1e-4)


def test_a_failed_solve_gives_no_time_but_a_reason() -> None:
    # Hovering takes 9.81 m/s^2, which this vehicle does not have: it cannot even start.
    weak = Quadrotor(thrust_min=1.0, thrust_max=5.0)
    found = plan(level_paths((0, 0), 3.0, -1.0, 1.0), weak, intervals=8)
    assert not found.converged
    assert found.time == np.inf
    assert found.violation == np.inf
    assert found.trajectory is None
    assert "Not solved" in found.status
    assert "try" in found.status


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"checks": "node"}, "checks must be"),
        ({"intervals": 3}, "intervals must be at least 4, got 3"),
        ({"ends": (0.5, 1.2)}, "ends must be"),
    ],
)
def test_bad_arguments_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        plan(level_paths((0, 0), 3.0, -1.0, 1.0), **changes)  # type: ignore[arg-type]


def test_paths_that_do_not_start_at_rest_are_refused() -> None:
    moving = PolynomialPath((0.0, 1.0), (0.0,)), PolynomialPath((0.0, 1.0), (1.0,))
    with pytest.raises(ValueError, match="at rest at both ends"):
        plan(moving)


@pytest.mark.parametrize("t", [-0.1, 99.0, np.nan])
def test_times_and_orders_outside_the_flight_are_refused(t: float) -> None:
    trajectory = flown("horizontal-3")
    with pytest.raises(ValueError, match="t must lie within the flight"):
        trajectory.state(t)
    with pytest.raises(ValueError, match="order must be 0, 1, 2 or 3"):
        trajectory(0.1, 4)
    with pytest.raises(ValueError, match="s must lie in"):
        trajectory.path(t if t < 0 else 1.5)
