"""Shooting against known optima, mirror symmetry, convergence with the grid, costates."""

from itertools import pairwise

import numpy as np
import pytest

from experiments.measurements.sections import REFERENCE_TIMES
from flatgym import SCENARIOS, Scenario
from optimal.direct.shooting import solve_winding

KNOWN = {name: time for name, time in REFERENCE_TIMES.items() if name != "climb"}
"""Optima of winding 0 [s]."""


@pytest.mark.parametrize(("name", "time"), KNOWN.items())
def test_known_optima_are_found_from_the_default_guess(name, time):
    shot = solve_winding(SCENARIOS[name])
    assert shot.converged
    assert abs(shot.trajectory.duration - time) < 5e-4


def test_a_flip_is_the_fastest_climb():
    times = {winding: solve_winding(SCENARIOS["climb"], winding).trajectory.duration for winding in (0, 1, -1)}
    assert abs(times[1] - 1.30037) < 5e-4
    assert abs(times[1] - times[-1]) < 1e-6
    assert times[0] > times[1] + 0.01


def test_mirrored_scenarios_take_the_same_time():
    right, left = Scenario("right", (1, 2), (4, 4)), Scenario("left", (-1, 2), (-4, 4))
    for winding in (0, 1):
        there, mirrored = solve_winding(right, winding).trajectory, solve_winding(left, -winding).trajectory
        assert abs(there.duration - mirrored.duration) < 1e-6


def test_times_decrease_and_converge_with_the_grid():
    times = [solve_winding(SCENARIOS["horizontal-6"], nodes=nodes).trajectory.duration for nodes in (25, 50, 100, 200)]
    # Halving every step keeps all old flights feasible.
    assert all(fine <= coarse + 1e-7 for coarse, fine in pairwise(times))
    assert times[-2] - times[-1] < 1e-4


@pytest.mark.parametrize(("name", "winding"), [("diagonal", 0), ("climb", 1)])
def test_the_time_converges_at_second_order(name, winding):
    # Held controls miss a switching time by up to a step, and T is stationary with respect to it.
    nodes = (25, 50, 100, 200, 400)
    limit = solve_winding(SCENARIOS[name], winding, nodes=1600).trajectory.duration
    errors = [solve_winding(SCENARIOS[name], winding, nodes=n).trajectory.duration - limit for n in nodes]
    order = -np.polyfit(np.log(nodes), np.log(errors), 1)[0]
    assert 1.7 < order < 2.5


def test_random_guesses_find_the_same_optimum(generator):
    times = [solve_winding(SCENARIOS["diagonal"], generator=generator).trajectory.duration for _ in range(3)]
    np.testing.assert_allclose(times, KNOWN["diagonal"], rtol=2e-4)


def test_position_costates_are_constant_and_velocity_costates_linear():
    costates = solve_winding(SCENARIOS["horizontal-6"]).costates
    np.testing.assert_allclose(costates[:, :2], costates[:1, :2].repeat(100, axis=0), atol=1e-7)
    np.testing.assert_allclose(np.diff(costates[:, 2:4], n=2, axis=0), 0, atol=1e-7)


def test_a_solve_that_does_not_converge_reports_it():
    shot = solve_winding(Scenario("far", (0, 0), (4000, 0)))
    assert not shot.converged
    assert shot.message != "SOLVER_RET_SUCCESS"
