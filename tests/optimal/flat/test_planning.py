"""Eq. (10): certified flights are close to the optimum and never below it; limits at nodes only give no flight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import optimal
from flatgym.quadrotor import Quadrotor
from flatgym.scenarios.catalogue import SCENARIOS
from optimal.flat.following import follow
from optimal.flat.initial_guess import INITIAL_SQUARED_SPEED, UNIT_STEP, motion, slow_start
from optimal.flat.limits import constraint_violation
from optimal.flat.planning import plan, pose
from optimal.flat.problem import PlanningProblem
from optimal.flat.program.solver import SUCCESS, solve_program
from optimal.flat.refinement import INTERVALS, _along_central_path
from optimal.flat.solution import FlatSolution
from optimal.flat.trajectory import FlatTrajectory
from optimal.paths.corridors import Corridor, paper_corridor
from optimal.paths.curves import BSplinePath, PolynomialPath, Resting, smoothstep
from optimal.systems import FullQuadrotor, PlanarQuadrotor

BEST = {
    "horizontal-3": 0.89870292,
    "horizontal-6": 1.23131929,
    "ground-6": 1.23408,
    "diagonal": 1.4112,
    "hoop": 1.41797,
}
"""Best flight times [s]: horizontals by Pontryagin's principle, the others by shooting with the exact step."""
LOSS = {"horizontal-3": 1e-3, "horizontal-6": 1e-3, "ground-6": 1e-3, "diagonal": 5e-3, "hoop": 5e-3}
"""Greatest relative excess of the time of a certified flight over the best time."""
PRINTED = [name for name in SCENARIOS if name.startswith(("horizontal", "ground"))] + ["diagonal", "hoop"]


@cache
def paper(name: str) -> Corridor:
    return paper_corridor(SCENARIOS[name])


@cache
def planned(name: str, conditions: str = "explicit", checks: str = "certified") -> FlatSolution:
    return plan(paper(name).paths, ends=paper(name).ends, conditions=conditions, checks=checks)


def flown(name: str) -> FlatTrajectory:
    trajectory = planned(name).trajectory
    assert trajectory is not None, planned(name).status
    return trajectory


def level(advance: float, *others: float) -> PolynomialPath:
    """Return a path that advances along x by the paper's q(s), its other coordinates constant."""
    return PolynomialPath((tuple((advance * smoothstep(3)).coef), *((other,) for other in others)))


def start_of(name: str, conditions: str) -> tuple[PlanningProblem, FlatTrajectory]:
    problem = pose(paper(name).paths, None, paper(name).ends, conditions, "certified")
    return problem, motion(problem, slow_start(problem, 8))


@pytest.mark.parametrize("name", BEST)
def test_certified_flights_are_close_to_the_best_and_never_below_it(name: str) -> None:
    solution = planned(name)
    assert solution.converged, solution.status
    assert solution.optimised, solution.status
    assert solution.violation <= 1e-6
    # The best times of shooting are rounded to the printed digits.
    assert -1e-5 < solution.time / BEST[name] - 1 < LOSS[name]
    assert solution.trajectory is not None
    assert solution.time == solution.trajectory.duration
    assert solution.intervals == len(solution.trajectory.nodes) - 1
    assert solution.status.startswith("Solved")


@pytest.mark.parametrize("name", BEST)
def test_an_independent_dense_sampling_finds_no_violation(name: str) -> None:
    trajectory, vehicle = flown(name), Quadrotor()
    control = trajectory.control(np.linspace(0, trajectory.duration, 10_001))
    assert control[:, 0].max() <= vehicle.thrust_max * (1 + 1e-6)
    assert control[:, 0].min() >= vehicle.thrust_min * (1 - 1e-6)
    assert np.abs(control[:, 1]).max() <= vehicle.rate_max * (1 + 1e-6)


@pytest.mark.parametrize("name", ["horizontal-3", "horizontal-6"])
def test_limits_at_nodes_only_give_impossible_times(name: str) -> None:
    solution = planned(name, checks="nodes")
    assert solution.converged, solution.status
    assert solution.time < BEST[name]
    assert solution.violation > 1
    assert "not a flight" in solution.status


@pytest.mark.parametrize("name", BEST)
def test_flights_begin_and_end_at_rest_upright_and_in_place(name: str) -> None:
    trajectory, task = flown(name), SCENARIOS[name]
    np.testing.assert_allclose(trajectory.state(0.0), task.start_state, atol=1e-6)
    np.testing.assert_allclose(trajectory.state(trajectory.duration), task.goal_state, atol=1e-6)
    for t in (0.0, trajectory.duration):
        np.testing.assert_allclose(trajectory(t, 1), 0, atol=1e-9)


def test_the_flight_stays_above_the_floor() -> None:
    trajectory = flown("ground-6")
    assert trajectory(np.linspace(0, trajectory.duration, 10_001))[:, 1].min() >= -1e-12


def test_a_flight_stays_between_its_outer_paths_and_passes_its_hoop() -> None:
    trajectory, (upper, lower) = flown("hoop"), paper("hoop").paths
    s = np.linspace(0, 1, 5001)
    heights = [path(s)[:, 1] for path in (upper, lower, trajectory.path)]
    assert np.all(heights[2] <= np.maximum(*heights[:2]) + 1e-12)
    assert np.all(heights[2] >= np.minimum(*heights[:2]) - 1e-12)
    x, z = trajectory.path(s).T
    assert abs(np.interp(2.5, x, z) - 2.5) <= 0.25 + 1e-6


@pytest.mark.parametrize("name", ["horizontal-3", "diagonal", "hoop"])
def test_states_and_controls_obey_the_equations_of_motion(
    name: str, replay_error: Callable[[FlatTrajectory], float]
) -> None:
    assert replay_error(flown(name)) < 1e-6


@pytest.mark.parametrize("order", [1, 2, 3])
def test_each_order_is_the_time_derivative_of_the_one_before(order: int) -> None:
    trajectory, h = flown("diagonal"), 1e-6
    middles = (trajectory.breakpoints[1:] + trajectory.breakpoints[:-1]) / 2
    difference = (trajectory(middles + h, order - 1) - trajectory(middles - h, order - 1)) / (2 * h)
    exact = trajectory(middles, order)
    np.testing.assert_allclose(difference, exact, atol=1e-5 * np.abs(exact).max())


def test_the_length_flown_is_the_length_of_the_path() -> None:
    trajectory = flown("diagonal")
    path = trajectory.path(np.linspace(0, 1, 10_001))
    t = np.linspace(0, trajectory.duration, 10_001)
    length = np.trapezoid(np.hypot(*trajectory(t, 1).T), t)
    assert length == pytest.approx(np.hypot(*np.diff(path, axis=0).T).sum(), rel=1e-6)


@pytest.mark.parametrize("name", PRINTED)
def test_the_slow_central_start_is_feasible(name: str) -> None:
    problem, flight = start_of(name, "explicit")
    assert constraint_violation(flight) == 0
    assert flight.duration == pytest.approx((INITIAL_SQUARED_SPEED * problem.speed_unit) ** -0.5, rel=1e-12)
    faster = replace(problem, speed_unit=problem.speed_unit * UNIT_STEP)
    assert constraint_violation(motion(faster, slow_start(problem, 8))) > 0
    weights = flight.weights(np.linspace(0, 1, 101))
    assert weights.min() >= -1e-15
    assert weights.max() <= 1 + 1e-15
    np.testing.assert_allclose(weights[[0, -1], 0], paper(name).ends[:, 0], atol=1e-15)


def test_implicit_end_conditions_are_never_faster_and_give_a_flight() -> None:
    implicit = planned("horizontal-6", conditions="implicit")
    assert implicit.converged, implicit.status
    assert implicit.violation <= 1e-6
    # Both are close to the same optimum, each with its own small loss.
    assert BEST["horizontal-6"] <= implicit.time < BEST["horizontal-6"] * (1 + 2e-3)
    assert implicit.time >= planned("horizontal-6").time * (1 - 2e-4)
    assert implicit.trajectory is not None
    for t in (0.0, implicit.time):
        np.testing.assert_allclose(implicit.trajectory(t, 1), 0, atol=1e-9)
        np.testing.assert_allclose(implicit.trajectory(t, 2), 0, atol=1e-6)


ORDER_GRIDS = [8, 12, 16, 24, 32]


@pytest.mark.parametrize("name", ["horizontal-3", "horizontal-6"])
def test_the_error_falls_nearly_with_the_square_of_the_interval(name: str) -> None:
    problem = pose(paper(name).paths, None, paper(name).ends, "explicit", "certified")
    errors = []
    for intervals in ORDER_GRIDS:
        iterate = solve_program(problem, slow_start(problem, intervals))
        assert iterate.outcome in SUCCESS
        errors.append(abs(motion(problem, iterate).duration / BEST[name] - 1))
    order = -np.polyfit(np.log(ORDER_GRIDS), np.log(errors), 1)[0]
    # Measured: 2.1 and 1.7. Bang-bang inputs switch inside an interval, which a polynomial cannot represent.
    assert 1.5 < order < 3


@pytest.mark.parametrize("name", ["horizontal-6", "hoop"])
def test_the_fallback_is_a_flight_along_the_central_path(name: str) -> None:
    problem = pose(paper(name).paths, None, paper(name).ends, "explicit", "certified")
    flight = _along_central_path(problem, slow_start(problem, 16))
    assert flight is not None
    assert constraint_violation(flight) <= 1e-6
    assert BEST[name] < flight.duration < 1 / np.sqrt(INITIAL_SQUARED_SPEED)
    s = np.linspace(0, 1, 51)
    assert np.abs(flight.path(s) - paper(name).central(s)).max() < 0.1


def test_a_third_path_between_two_changes_nothing() -> None:
    three = plan([level(6, -1), level(6, 0), level(6, 1)], intervals=16)
    assert three.converged, three.status
    assert three.trajectory is not None
    assert three.trajectory.weights(0.3).shape == (2,)
    assert three.time == pytest.approx(BEST["horizontal-6"], rel=2e-3)
    assert three.time >= BEST["horizontal-6"]


def test_a_displacement_along_x_takes_the_same_time_in_space_as_in_the_plane(
    replay_error: Callable[[FlatTrajectory], float],
) -> None:
    solution = plan([level(6, 0, -1, 0), level(6, 0, 1, 0)], FullQuadrotor(), intervals=16)
    assert solution.converged, solution.status
    assert solution.time == pytest.approx(BEST["horizontal-6"], rel=2e-3)
    assert solution.time >= BEST["horizontal-6"]
    assert solution.trajectory is not None
    assert solution.violation <= 1e-6
    assert replay_error(solution.trajectory) < 1e-6


def test_a_quadrotor_in_space_flies_through_two_gates() -> None:
    # Outer paths through the corners of square gates at x = 2 and 4 m; the control points of a gate lie in its plane.
    gates, half = {2.0: (0.5, 0.4), 4.0: (-0.5, 0.6)}, 0.3
    x = np.array([0, 0, 0, 0.4, 0.8, 1.2, 1.6, 2, 2.4, 2.8, 3.2, 3.6, 4, 4.4, 4.8, 5.2, 5.6, 6, 6, 6])
    y, z = (np.interp(x, [0, 2, 4, 6], [0, *(place[i] for place in gates.values()), 0]) for i in range(2))
    corners = [(1, 1), (1, -1), (-1, -1), (-1, 1)]
    points = [np.stack([x, y + a * half, z + b * half, 0 * x], axis=-1) for a, b in corners]
    solution = plan([BSplinePath(tuple(map(tuple, each.tolist()))) for each in points], FullQuadrotor(), intervals=16)
    assert solution.optimised, solution.status
    assert solution.violation <= 1e-6
    assert solution.trajectory is not None
    s = np.linspace(0.0, 1.0, 4001)
    places = solution.trajectory.path(s)
    walls = np.stack([path(s) for path in solution.trajectory.outer_paths])
    for at in gates:
        i = int(np.argmin(np.abs(places[:, 0] - at)))
        assert (places[i] >= walls[:, i].min(axis=0) - 1e-9).all()
        assert (places[i] <= walls[:, i].max(axis=0) + 1e-9).all()


def test_mirrored_and_exchanged_outer_paths_give_the_same_time() -> None:
    for paths in ([level(-6, -1), level(-6, 1)], [level(6, 1), level(6, -1)]):
        assert plan(paths).time == pytest.approx(planned("horizontal-6").time, rel=1e-5)


def test_a_stronger_vehicle_is_faster() -> None:
    strong = plan([level(6, -1), level(6, 1)], Quadrotor(thrust_max=25.0), intervals=16)
    assert strong.converged, strong.status
    assert strong.time < 0.97 * planned("horizontal-6").time


def test_the_same_problem_has_the_same_answer() -> None:
    again = plan(paper("horizontal-6").paths, ends=paper("horizontal-6").ends)
    assert again.time == planned("horizontal-6").time
    assert again.iterations == planned("horizontal-6").iterations


class Unchecked(PlanarQuadrotor):
    """A planar quadrotor that may have no motion."""

    def __post_init__(self) -> None:
        """Take any vehicle."""


def test_a_failed_solve_gives_a_reason_and_no_time() -> None:
    solution = plan([level(3, -1), level(3, 1)], Unchecked(Quadrotor(thrust_max=5.0)), intervals=4)
    assert not solution.converged
    assert solution.time == np.inf
    assert solution.violation == np.inf
    assert solution.trajectory is None
    assert solution.status.startswith("Not solved")
    assert "start on another number of intervals" in solution.status


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"checks": "node"}, r'checks must be "certified" or "nodes", got \'node\''),
        ({"conditions": "exact"}, r'conditions must be "explicit" or "implicit", got \'exact\''),
        ({"intervals": 3}, "intervals must be at least 4, got 3"),
        ({"ends": (0.5, 1.2)}, "ends must be 2 weights >= 0 with sum 1"),
        ({"ends": [[0.5, 0.5], [1.2, -0.2]]}, "ends must be 2 weights"),
        ({"ends": [[0.5, 0.5], [0.5, np.nan]]}, "ends must be 2 weights"),
    ],
)
def test_bad_arguments_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        plan([level(3, -1), level(3, 1)], **changes)  # type: ignore[arg-type]


def test_one_path_is_no_corridor() -> None:
    with pytest.raises(ValueError, match="at least two paths, got 1; `follow` takes a single one"):
        plan([level(3, -1)])


def test_paths_that_do_not_start_at_rest_are_refused() -> None:
    moving = PolynomialPath(((0.0, 1.0), (0.0,))), PolynomialPath(((0.0, 1.0), (1.0,)))
    with pytest.raises(ValueError, match="at rest at both ends"):
        plan(moving)


def test_paths_of_another_number_of_coordinates_are_refused() -> None:
    with pytest.raises(ValueError, match="2 coordinates, but FullQuadrotor needs 4: x_m, y_m, z_m, yaw_rad"):
        plan([level(3, -1), level(3, 1)], FullQuadrotor())


def test_outer_paths_without_displacement_are_refused() -> None:
    with pytest.raises(ValueError, match="the central path between the outer paths stands still"):
        plan([level(0, -1), level(0, 1)], intervals=4)


def test_implicit_conditions_require_more_derivatives_at_rest() -> None:
    # The paper's hoop paths use r(s), whose second derivative does not vanish at the ends.
    with pytest.raises(ValueError, match="got derivative 2 with respect to s"):
        planned("hoop", conditions="implicit")


def test_the_default_grid_is_kept_if_it_is_fine_enough() -> None:
    assert planned("horizontal-6").intervals == INTERVALS


def test_outer_paths_with_a_jump_are_refused_with_its_place() -> None:
    kinked = Resting(BSplinePath(((0.0, -1.0), (2.0, -1.0), (2.0, 1.0), (6.0, -1.0)), 2))
    with pytest.raises(ValueError, match=r"path 1 is not smooth at s = 0\.5: its derivative of order 2 jumps"):
        plan([level(6, 1), kinked])


def test_without_gravity_a_flat_quadrotor_is_refused_before_any_solve(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("optimal.flat.planning.optimise", lambda *_: pytest.fail("a solve began"))
    weightless = Quadrotor(gravity=0.0, thrust_min=0.0)
    for refused in (
        lambda: plan([level(6, -1), level(6, 1)], weightless),
        lambda: PlanarQuadrotor(weightless),
        lambda: optimal.solve(replace(SCENARIOS["horizontal-6"], quadrotor=weightless), "flat"),
    ):
        with pytest.raises(ValueError, match=r"needs gravity > 0.*got Quadrotor\.gravity = 0\.0; use `optimal\.solve"):
            refused()
    with pytest.raises(ValueError, match=r"FullQuadrotor\.gravity must be positive.*got 0\.0"):
        FullQuadrotor(gravity=0.0, thrust_min=0.0)


@pytest.mark.parametrize(
    ("vehicle", "limits"),
    [
        (Quadrotor(thrust_max=5.0), r"1\.0 <= 9\.81 <= 5\.0 - 1e-06"),
        (Quadrotor(thrust_max=9.81), r"1\.0 <= 9\.81 <= 9\.81 - 1e-06"),
        (Quadrotor(thrust_min=10.0), r"10\.0 <= 9\.81 <= 20\.0 - 1e-06"),
        (Quadrotor(gravity=0.5), r"1\.0 <= 0\.5 <= 20\.0 - 1e-06"),
        (Quadrotor(gravity=24.8), r"1\.0 <= 24\.8 <= 20\.0 - 1e-06"),
    ],
)
def test_a_vehicle_that_cannot_hover_is_refused_before_any_solve(
    vehicle: Quadrotor, limits: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("planning", "following"):
        monkeypatch.setattr(f"optimal.flat.{module}.optimise", lambda *_: pytest.fail("a solve began"))
    for refused in (
        lambda: plan([level(6, -1), level(6, 1)], vehicle),
        lambda: follow(level(6, 0), vehicle),
        lambda: replace(SCENARIOS["horizontal-6"], quadrotor=vehicle),
    ):
        with pytest.raises(ValueError, match=f"uadrotor cannot hover.*thrust_min <= gravity <= thrust_max.*{limits}"):
            refused()


@pytest.mark.parametrize("vehicle", [Quadrotor(thrust_min=0.5), Quadrotor(thrust_min=0.0)])
def test_other_limits_of_the_thrust_are_flown(vehicle: Quadrotor) -> None:
    solution = plan([level(6, -1), level(6, 1)], vehicle, intervals=16)
    assert solution.converged, solution.status
    assert solution.violation <= 1e-6
