"""Eq. (8): closed-form times, times of reachability analysis, and motions repeated by another integrator."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import ArrayLike
from toppra.algorithm import TOPPRA
from toppra.constraint import DiscretizationType, JointAccelerationConstraint, JointVelocityConstraint
from toppra.interpolator import AbstractGeometricPath

from flatgym.quadrotor import Array
from optimal.flat.following import follow
from optimal.flat.refinement import INTERVALS
from optimal.flat.solution import FlatSolution
from optimal.flat.trajectory import FlatTrajectory
from optimal.paths.curves import BezierPath, BSplinePath, Path, PolynomialPath
from optimal.systems import FlatSystem, FullQuadrotor, OverheadCrane, PlanarQuadrotor, PointMass

PLANNED_6 = 1.23131929
"""The best time of 6 m horizontally [s], from Pontryagin's principle."""
LINE = PolynomialPath(((0.0, 3.0), (0.0, 4.0)))
BEZIER = BezierPath(((0.0, 0.0), (1.0, 2.0), (3.0, -2.0), (4.0, 1.0)))
SPLINE = BSplinePath(((0.0, 0.0), (1.0, 0.5), (1.5, 2.0), (3.0, 2.0), (3.5, 0.0), (5.0, 0.0), (5.0, 1.0)), 4)


class Circle:
    """A horizontal circle of 2 m radius, 1 m high, with constant yaw."""

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        s = np.asarray(s, dtype=np.float64)
        angle, zero = 2 * np.pi * s + order * np.pi / 2, np.zeros_like(s)
        arm = 2.0 * (2 * np.pi) ** order
        return np.stack([arm * np.cos(angle), arm * np.sin(angle), zero + (order == 0), zero], axis=-1)


MOTIONS: dict[str, tuple[Path, FlatSystem]] = {
    "line": (LINE, PointMass()),
    "limited line": (LINE, PointMass(speed_max=2.0)),
    "bezier": (BEZIER, PointMass(acceleration_max=5.0)),
    "limited bezier": (BEZIER, PointMass(speed_max=2.0, acceleration_max=5.0)),
    "spline": (SPLINE, PointMass(speed_max=3.0)),
    "planar": (PolynomialPath(((0.0, 6.0), (0.0,))), PlanarQuadrotor()),
    "circle": (Circle(), FullQuadrotor()),
    "crane": (BezierPath(((0.0, -4.0), (1.0, -2.0), (3.0, -2.0), (4.0, -4.0))), OverheadCrane()),
}

COARSE = {"circle": 24, "crane": 16}
"""Intervals of the first grid where programs are large."""


@cache
def followed(name: str) -> FlatSolution:
    return follow(*MOTIONS[name], intervals=COARSE.get(name, INTERVALS))


def flown(name: str) -> FlatTrajectory:
    trajectory = followed(name).trajectory
    assert trajectory is not None, followed(name).status
    return trajectory


@pytest.mark.parametrize(
    ("name", "exact"),
    # 4 m along the longer axis: from rest to rest at 10 m/s^2, and with a cruise at 2 m/s.
    [("line", 2 * np.sqrt(4 / 10)), ("limited line", 4 / 2 + 2 / 10)],
)
def test_a_point_mass_takes_its_closed_form_time(name: str, exact: float) -> None:
    assert exact <= followed(name).time < exact * (1 + 1e-3)


class _Geometry(AbstractGeometricPath):  # type: ignore[misc]
    """Adapter of a path to the interface of toppra."""

    dof, path_interval = 2, np.array([0.0, 1.0])

    def __init__(self, path: Path) -> None:
        self.path = path

    def __call__(self, s: ArrayLike, order: int = 0) -> Array:
        return self.path(s, order)


def reachability_time(path: Path, system: PointMass) -> float:
    """Return the time of toppra's reachability analysis [s], extrapolated over two grids."""
    velocity = JointVelocityConstraint(np.full(2, min(system.speed_max, 1e3)))
    acceleration = JointAccelerationConstraint(
        np.full(2, system.acceleration_max), discretization_scheme=DiscretizationType.Interpolation
    )
    coarse, fine = (
        TOPPRA([velocity, acceleration], _Geometry(path), gridpoints=np.linspace(0, 1, n + 1), solver_wrapper="seidel")
        .compute_trajectory(0, 0)
        .duration
        for n in (500, 1000)
    )
    return float(2 * fine - coarse)


@pytest.mark.parametrize("name", ["bezier", "limited bezier", "spline"])
def test_times_agree_with_reachability_analysis(name: str) -> None:
    path, system = MOTIONS[name]
    assert isinstance(system, PointMass)
    assert followed(name).time == pytest.approx(reachability_time(path, system), rel=5e-3)


def test_a_followed_path_is_no_faster_than_a_planned_one() -> None:
    assert followed("planar").time >= PLANNED_6


@pytest.mark.parametrize("name", MOTIONS)
def test_limits_hold_in_continuous_time(name: str) -> None:
    trajectory, system = flown(name), MOTIONS[name][1]
    t = np.linspace(0, trajectory.duration, 5_001)
    values = np.concatenate([trajectory.state(t), trajectory.control(t)], axis=-1)
    state_low, state_high, input_low, input_high = system.limits()
    low, high = np.append(state_low, input_low), np.append(state_high, input_high)
    slack = 1e-6 * system.bounds[1].max()
    assert np.all(values >= low - slack)
    assert np.all(values <= high + slack)
    assert followed(name).violation <= 1e-6


@pytest.mark.parametrize("name", MOTIONS)
def test_the_motion_follows_the_given_path_from_rest_to_rest(name: str) -> None:
    trajectory, path = flown(name), MOTIONS[name][0]
    for t, s in ((0.0, 0.0), (trajectory.duration, 1.0)):
        np.testing.assert_allclose(trajectory(t), path(s), atol=1e-12)
        for order in range(1, trajectory.system.order):
            np.testing.assert_allclose(trajectory(t, order), 0, atol=1e-8)
    curve = path(np.linspace(0, 1, 20_001))
    points = trajectory(np.linspace(0, trajectory.duration, 7))
    assert np.linalg.norm(points[:, None] - curve, axis=-1).min(axis=1).max() < 1e-3


@pytest.mark.parametrize("name", ["limited bezier", "planar", "circle", "crane"])
def test_an_independent_integration_repeats_the_motion(
    name: str, replay_error: Callable[[FlatTrajectory], float]
) -> None:
    assert replay_error(flown(name)) < 1e-6


def test_thrust_bounds_the_speed_on_a_circle() -> None:
    trajectory, vehicle = flown("circle"), FullQuadrotor()
    thrust = trajectory.control(np.linspace(0, trajectory.duration, 5001))[:, 0]
    # The fastest circle uses the full thrust, for gravity and centripetal force together.
    assert thrust.max() > 0.99 * vehicle.thrust_max
    speed = np.linalg.norm(trajectory(np.linspace(0, trajectory.duration, 5001), 1), axis=-1)
    assert speed.max() ** 2 / 2.0 <= np.sqrt(vehicle.thrust_max**2 - vehicle.gravity**2) * (1 + 1e-6)


def test_the_reversed_path_takes_the_same_time() -> None:
    back = BezierPath(BEZIER.points[::-1])
    assert follow(back, PointMass(acceleration_max=5.0)).time == pytest.approx(followed("bezier").time, rel=1e-5)


def test_limits_at_nodes_only_are_violated_between_them() -> None:
    solution = follow(BEZIER, PointMass(acceleration_max=5.0), checks="nodes")
    assert not solution.converged or solution.time < followed("bezier").time
    assert solution.violation > 0


def test_an_infeasible_path_gives_a_reason() -> None:
    # A rope of at least 5 m is too long for a load one metre below the rail.
    solution = follow(PolynomialPath(((0.0, 2.0), (-1.0,))), OverheadCrane(rope_min=5.0), intervals=4)
    assert not solution.converged
    assert solution.time == np.inf
    assert solution.violation == np.inf
    assert solution.trajectory is None
    assert solution.status.startswith("Not solved")


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (PolynomialPath(((0.0, -1.0, 1.0), (0.0,))), "degenerate: its derivative vanishes at s = 0.5"),
        (PolynomialPath(((1.0,), (2.0,))), "degenerate"),
        (PolynomialPath(((0.0, 1.0), (0.0,), (0.0,))), "3 coordinates, but PlanarQuadrotor needs 2: x_m, z_m"),
    ],
)
def test_degenerate_paths_are_refused(path: Path, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        follow(path)


L_SHAPE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
Z_SHAPE = (*L_SHAPE, (2.0, 1.0))
CORNERS: dict[str, tuple[Path, FlatSystem, str, int]] = {
    "L": (BSplinePath(L_SHAPE, 1), PointMass(speed_max=1.0), "0.5", 1),
    "Z": (BSplinePath(Z_SHAPE, 1), PointMass(), "0.3333", 1),
    "Z, knots off the grid": (BSplinePath(Z_SHAPE, 1, (0, 0, 0.31, 0.7377, 1, 1)), PointMass(), "0.7377", 1),
    "a straight line at two speeds": (BSplinePath(((0, 0), (0.9, 0), (2, 0)), 1), PointMass(), "0.5", 1),
    "parabolas": (BSplinePath(Z_SHAPE, 2), PlanarQuadrotor(), "0.5", 2),
    "triple knot": (
        BSplinePath((*Z_SHAPE, (2.0, 2.0), (3.0, 2.0), (3.0, 3.0)), 3, (0,) * 4 + (0.3,) * 3 + (1,) * 4),
        PointMass(),
        "0.3",
        1,
    ),
    "cubics under a crane": (
        BSplinePath(((0, -4), (1, -2), (2, -3), (3, -2), (4, -4)), 3), OverheadCrane(), "0.5", 3
    ),
    "any function": (lambda s, order=0: LINE(s, order) * (1 + (np.asarray(s)[..., None] > 0.6)), PointMass(), "0.6", 0),
}  # fmt: skip


@pytest.mark.parametrize("name", CORNERS)
def test_a_path_with_a_jump_is_refused_with_its_place(name: str) -> None:
    path, system, place, order = CORNERS[name]
    with pytest.raises(ValueError, match=rf"not smooth at s = {place}: its derivative of order {order} jumps by"):
        follow(path, system)


def test_a_path_with_a_jump_that_the_system_does_not_feel_is_flown() -> None:
    # y'' jumps: an input of the point mass.
    assert follow(BSplinePath(Z_SHAPE, 2), PointMass()).converged


def test_multiple_knots_of_a_smooth_path_change_nothing() -> None:
    plain = follow(BSplinePath(((0.0, 0.0), (3.0, 0.0)), 1), PointMass())
    for points, degree, inner in (((0, 1, 2, 3), 1, (1 / 3, 2 / 3)), ((0, 0.5, 1, 1.5, 2, 2.5, 3), 3, (0.5,) * 3)):
        knots = (0.0,) * (degree + 1) + inner + (1.0,) * (degree + 1)
        path = BSplinePath(tuple((float(x), 0.0) for x in points), degree, knots)
        assert follow(path, PointMass()).time == pytest.approx(plain.time, rel=1e-9)


STRAIGHT = tuple((x, 0.0) for x in np.linspace(0, 6, 8).tolist())


@pytest.mark.parametrize(
    "path",
    [
        BSplinePath((STRAIGHT[0], *STRAIGHT)),
        BSplinePath((STRAIGHT[0], *STRAIGHT, STRAIGHT[-1])),
        BSplinePath((*STRAIGHT[:1] * 3, *STRAIGHT[1:-1], *STRAIGHT[-1:] * 3)),
        BezierPath((STRAIGHT[0], STRAIGHT[0], STRAIGHT[-1], STRAIGHT[-1])),
    ],
)
def test_repeated_end_points_do_not_change_the_time(path: Path) -> None:
    solution = follow(path)
    assert solution.optimised, solution.status
    assert PLANNED_6 < solution.time == pytest.approx(followed("planar").time, rel=0.015)


@pytest.mark.parametrize("length", [1e-4, 1e-3, 1e4])
def test_the_time_scales_with_the_root_of_the_length(length: float) -> None:
    solution = follow(BezierPath(((0.0, 0.0), (length, 0.0))), PointMass(acceleration_max=10.0))
    assert 2 * np.sqrt(length / 10) <= solution.time < 2 * np.sqrt(length / 10) * (1 + 1e-3)


def test_a_path_that_is_not_finite_is_refused() -> None:
    def path(s: ArrayLike, order: int = 0) -> Array:
        values = LINE(s, order)
        return np.where(np.asarray(s)[..., None] > 0.7, np.nan, values)

    with pytest.raises(ValueError, match=r"not finite at s = 0\.7"):
        follow(path, PointMass())
