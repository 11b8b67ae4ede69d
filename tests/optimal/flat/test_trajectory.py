"""Flat motions: times in closed form, derivatives, violation of limits, and uniform time scaling."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import BSpline

from flatgym.quadrotor import Quadrotor
from optimal.flat.limits import constraint_violation, interval_violations, slowed_to_limits
from optimal.flat.splines import SplineSpace
from optimal.flat.trajectory import FlatTrajectory
from optimal.paths.curves import PolynomialPath, smoothstep
from optimal.systems import FlatSystem, OverheadCrane, PlanarQuadrotor, PointMass

NODES = np.array([0.0, 0.2, 0.55, 0.7, 1.0])
ADVANCE = tuple((4.0 * smoothstep(4)).coef)
OUTER = PolynomialPath((ADVANCE, (-1.0,))), PolynomialPath((ADVANCE, (2.0,)))
SYSTEMS = [PlanarQuadrotor(), PointMass(), OverheadCrane(rope_min=0.1)]
IDS = [type(system).__name__ for system in SYSTEMS]


def speed(polynomial: tuple[float, float, float], nodes: np.ndarray = NODES) -> BSpline:
    """Return b(s) = c0 + c1 s + c2 s^2 as a spline."""
    space = SplineSpace(nodes, 3, 2)
    return space.spline(space.fitted(lambda s: np.polynomial.polynomial.polyval(s, polynomial)))


def motion(
    system: FlatSystem = SYSTEMS[0], squared_speed: tuple[float, float, float] = (0.2, 0.5, -0.4), below: float = 0.0
) -> FlatTrajectory:
    """Return a motion whose weight rises and falls smoothly, lowered by `below`."""
    space = SplineSpace(NODES, system.order + 1, 2)
    weights = 0.5 + 0.2 * np.sin(5 * space.centres[:, None])
    outer = tuple(PolynomialPath((ADVANCE, (path.coefficients[1][0] - below,))) for path in OUTER)
    return FlatTrajectory(system, outer, NODES, space.spline(weights), speed(squared_speed))


def single(squared_speed: BSpline, advance: float = 4.0) -> FlatTrajectory:
    """Return one path travelled by the planar quadrotor."""
    path = PolynomialPath((tuple((advance * smoothstep(3)).coef), (0.0,)))
    nothing = SplineSpace(NODES, 4, 2).spline(np.zeros((SplineSpace(NODES, 4, 2).size, 0)))
    return FlatTrajectory(PlanarQuadrotor(), (path,), NODES, nothing, squared_speed)


def test_a_constant_speed_takes_its_closed_form_time() -> None:
    assert single(speed((0.01, 0.0, 0.0))).duration == pytest.approx(10.0, rel=1e-13)
    np.testing.assert_allclose(single(speed((0.01, 0.0, 0.0))).breakpoints, 10 * NODES, rtol=1e-13)


def test_a_squared_speed_that_grows_linearly_takes_its_closed_form_time() -> None:
    # The integral of ds/sqrt(c + d s) is 2 (sqrt(c + d) - sqrt(c)) / d.
    exact = 2 * (np.sqrt(0.9) - np.sqrt(0.2)) / 0.7
    assert single(speed((0.2, 0.7, 0.0))).duration == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("curvature", [-0.5, -1e-9, 1e-9, 0.7])
def test_other_times_are_those_of_fine_quadrature(curvature: float) -> None:
    u, w = np.polynomial.legendre.leggauss(80)
    s = (u + 1) / 2
    exact = float((w / 2 / np.sqrt(0.2 + 0.4 * s + curvature * s**2)).sum())
    assert single(speed((0.2, 0.4, curvature))).duration == pytest.approx(exact, rel=1e-11)


@pytest.mark.parametrize("system", SYSTEMS, ids=IDS)
def test_each_order_is_the_time_derivative_of_the_one_before(system: FlatSystem) -> None:
    trajectory, h = motion(system, below=5.0), 1e-5
    middles = (trajectory.breakpoints[1:] + trajectory.breakpoints[:-1]) / 2
    for order in range(1, system.order + 1):
        difference = (trajectory(middles + h, order - 1) - trajectory(middles - h, order - 1)) / (2 * h)
        exact = trajectory(middles, order)
        np.testing.assert_allclose(difference, exact, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("system", SYSTEMS, ids=IDS)
def test_states_and_inputs_obey_the_equations_of_motion(
    system: FlatSystem, replay_error: Callable[[FlatTrajectory], float]
) -> None:
    assert replay_error(motion(system, below=5.0)) < 1e-6


def test_time_and_path_coordinate_are_inverse_to_each_other() -> None:
    trajectory = motion()
    s = trajectory.path_coordinate(np.linspace(0, trajectory.duration, 1001))
    assert s[0] == 0
    assert s[-1] == pytest.approx(1, abs=1e-14)
    assert np.diff(s).min() > 0
    np.testing.assert_allclose(trajectory.path_coordinate(trajectory.breakpoints), NODES, atol=1e-14)
    u, w = np.polynomial.legendre.leggauss(30)
    for t in (0.3, 1.1):
        end = float(trajectory.path_coordinate(t))
        cuts = np.append(NODES[: np.searchsorted(NODES, end)], end)
        points = cuts[:-1, None] + np.diff(cuts)[:, None] * (u + 1) / 2
        elapsed = (np.diff(cuts)[:, None] * w / 2 * trajectory.squared_speed(points) ** -0.5).sum()
        assert elapsed == pytest.approx(t, rel=1e-12)


def test_the_path_is_the_mean_of_the_outer_paths_by_its_weights() -> None:
    trajectory, s = motion(), np.linspace(0, 1, 21)
    p = trajectory.weights(s)
    np.testing.assert_allclose(trajectory.path(s), p * OUTER[0](s) + (1 - p) * OUTER[1](s), atol=1e-13)
    assert np.all((trajectory.path(s)[:, 1] > -1) & (trajectory.path(s)[:, 1] < 2))


def test_the_length_flown_is_the_length_of_the_path() -> None:
    trajectory = motion()
    path = trajectory.path(np.linspace(0, 1, 20_001))
    t = np.linspace(0, trajectory.duration, 20_001)
    flown = np.trapezoid(np.hypot(*trajectory(t, 1).T), t)
    assert flown == pytest.approx(np.hypot(*np.diff(path, axis=0).T).sum(), rel=1e-6)


def test_angles_are_unwrapped_beyond_half_a_turn() -> None:
    # In a loop of 1 m radius at more than 4 m/s, the thrust points towards the centre throughout.
    turns = np.linspace(0, 1, 65)
    points = np.stack([np.sin(2 * np.pi * turns), 1 - np.cos(2 * np.pi * turns)], axis=-1)
    loop = FlatTrajectory(
        PlanarQuadrotor(),
        (_Loop(),),
        NODES,
        SplineSpace(NODES, 4, 2).spline(np.zeros((SplineSpace(NODES, 4, 2).size, 0))),
        speed((1.0, 0.0, 0.0)),
    )
    t = np.linspace(0, 1, 65)
    tilt = loop.state(t)[:, 4]
    np.testing.assert_allclose(loop(t), points, atol=1e-12)
    assert np.abs(np.diff(tilt)).max() < 0.3
    assert abs(tilt[-1] - tilt[0]) == pytest.approx(2 * np.pi, abs=1e-9)


class _Loop:
    """A vertical circle of 1 m radius from its lowest point."""

    def __call__(self, s: np.ndarray, order: int = 0) -> np.ndarray:
        s = np.asarray(s, dtype=np.float64)
        angle = 2 * np.pi * s + order * np.pi / 2
        return (2 * np.pi) ** order * np.stack([np.sin(angle), -np.cos(angle)], axis=-1) + [0, order == 0]


def test_at_a_breakpoint_values_are_those_of_the_interval_that_begins_there() -> None:
    trajectory = motion()
    t = trajectory.breakpoints[2]
    after, before = trajectory.control([t, t + 1e-9, t - 1e-9])[[1, 2]]
    np.testing.assert_allclose(trajectory.control(t), after, atol=1e-5)
    assert np.abs(after - before).max() > 1e-3


@pytest.mark.parametrize("system", SYSTEMS, ids=IDS)
def test_batched_values_equal_single_values(system: FlatSystem) -> None:
    trajectory = motion(system, below=5.0)
    t = np.linspace(0, trajectory.duration, 6).reshape(2, 3)
    assert trajectory(t, 2).shape == (2, 3, 2)
    assert trajectory.state(t).shape == (2, 3, len(system.states))
    assert trajectory.control(t).shape == (2, 3, len(system.inputs))
    assert trajectory.control(0.1).shape == (len(system.inputs),)
    np.testing.assert_allclose(trajectory.state(t)[1, 2], trajectory.state(t[1, 2]), rtol=1e-13, atol=1e-13)


def test_the_violation_is_zero_for_a_slow_motion_and_agrees_with_sampling_for_a_fast_one() -> None:
    assert constraint_violation(single(speed((0.02, 0.0, 0.0)))) == 0
    fast, vehicle = single(speed((1.5, 0.0, 0.0))), Quadrotor()
    control = fast.control(np.linspace(0, fast.duration, 40_001))
    over = control[:, 0].max() / vehicle.thrust_max - 1, np.abs(control[:, 1]).max() / vehicle.rate_max - 1
    assert constraint_violation(fast) == pytest.approx(max(over), rel=1e-3)
    assert interval_violations(fast).shape == (2, 2, len(NODES) - 1)
    assert interval_violations(fast)[0, 0].max() == pytest.approx(over[0], rel=1e-3)


def test_time_scaling_slows_a_motion_just_enough() -> None:
    slow = single(speed((0.02, 0.0, 0.0)))
    # The slowest of these motions that violates a limit by more than 0.2 %.
    fast = next(m for b in np.arange(0.1, 2.0, 0.01) if constraint_violation(m := single(speed((b, 0.0, 0.0)))) > 0.002)
    assert constraint_violation(fast) < 0.1
    scaled = slowed_to_limits(fast, 1.2)
    assert scaled is not None
    assert constraint_violation(scaled) == 0
    assert interval_violations(scaled).max() > -0.1
    np.testing.assert_allclose(scaled.breakpoints / scaled.duration, slow.breakpoints / slow.duration, atol=1e-14)
    assert slowed_to_limits(fast, 1.0001) is None


def test_a_motion_within_limits_is_not_scaled() -> None:
    slow = single(speed((0.02, 0.0, 0.0)))
    scaled = slowed_to_limits(slow, 1.0)
    assert scaled is not None
    assert scaled.duration == slow.duration


@pytest.mark.parametrize("t", [-0.1, 99.0, np.nan])
def test_times_orders_and_coordinates_outside_the_motion_are_refused(t: float) -> None:
    trajectory = motion()
    with pytest.raises(ValueError, match="t must lie within the flight, from 0 to"):
        trajectory.state(t)
    with pytest.raises(ValueError, match="t must lie within the flight"):
        trajectory.control([0.1, t])
    with pytest.raises(ValueError, match="order must be one of 0, 1, 2, 3, got 4"):
        trajectory(0.1, 4)
    with pytest.raises(ValueError, match=r"s must lie in \[0, 1\]"):
        trajectory.path(t)


def test_only_a_planar_quadrotor_has_the_attribute_quadrotor() -> None:
    assert motion().quadrotor == Quadrotor()
    with pytest.raises(AttributeError, match="motion of a PointMass"):
        _ = motion(PointMass()).quadrotor
