"""Shooting against the known optima, mirror symmetry, refinement, and the exact step as symbols."""

from itertools import pairwise

import casadi
import numpy as np
import pytest

from flatgym import SCENARIOS, Scenario
from optimal.shooting import bounds, first_guess, phase_steps, program, shoot
from optimal.transcription import gaps, step_function

KNOWN = {
    "horizontal-3": 0.8987,
    "horizontal-6": 1.23132,
    "horizontal-9": 1.48822,
    "horizontal-12": 1.70490,
    "horizontal-15": 1.89584,
    "ground-6": 1.23408,
    "diagonal": 1.4112,
    "hoop": 1.41143,
}
"""Flight times [s] found independently, by other code and finer grids, before this project."""


@pytest.mark.parametrize(("name", "time"), KNOWN.items())
def test_known_optima_are_found_from_the_plain_start(name, time):
    shot = shoot(SCENARIOS[name])
    assert shot.converged
    assert abs(shot.trajectory.duration - time) < 5e-4


def test_a_flip_is_fastest_upwards():
    times = {winding: shoot(SCENARIOS["climb"], winding).trajectory.duration for winding in (0, 1, -1)}
    assert abs(times[1] - 1.30037) < 5e-4
    assert abs(times[1] - times[-1]) < 1e-6
    assert times[0] > times[1] + 0.01


def test_mirrored_scenarios_take_the_same_time():
    right, left = Scenario("right", (1, 2), (4, 4)), Scenario("left", (-1, 2), (-4, 4))
    for winding in (0, 1):
        there, mirrored = shoot(right, winding).trajectory, shoot(left, -winding).trajectory
        assert abs(there.duration - mirrored.duration) < 1e-6


def test_refining_the_grid_never_flies_slower_and_converges():
    times = [shoot(SCENARIOS["horizontal-6"], nodes=nodes).trajectory.duration for nodes in (25, 50, 100, 200)]
    # Halving every step keeps all old flights possible.
    assert all(fine <= coarse + 1e-7 for coarse, fine in pairwise(times))
    assert times[-2] - times[-1] < 1e-4


def test_random_starts_find_the_same_optimum(generator):
    times = [shoot(SCENARIOS["diagonal"], generator=generator).trajectory.duration for _ in range(3)]
    np.testing.assert_allclose(times, KNOWN["diagonal"], rtol=2e-4)


def test_symbolic_step_is_the_numeric_step(generator, quadrotor):
    step = step_function()
    for rate in (0.0, 1e-9, 3.0, -10.0):
        state, h = generator.normal(size=5), generator.uniform(0.01, 0.6)
        control = np.array([generator.uniform(1, 20), rate])
        numeric = quadrotor.step(state, control, h)
        np.testing.assert_allclose(np.array(step(state, control, h, quadrotor.gravity))[:, 0], numeric, atol=1e-12)
        jacobian = casadi.Function("j", step.sx_in(), [casadi.jacobian(step(*step.sx_in()), step.sx_in()[1])])
        symbolic = np.array(jacobian(state, control, h, quadrotor.gravity))
        for i, bump in enumerate(np.eye(2) * 1e-6):
            difference = quadrotor.step(state, control + bump, h) - quadrotor.step(state, control - bump, h)
            np.testing.assert_allclose(symbolic[:, i], difference / 2e-6, atol=1e-8)


def test_gaps_vanish_along_a_flight(generator, quadrotor):
    controls = generator.uniform(quadrotor.control_low, quadrotor.control_high, (7, 2))
    states = [np.zeros(5)]
    for control in controls:
        states.append(quadrotor.step(states[-1], control, 0.03))
    gap = gaps(casadi.DM(np.array(states).T), casadi.DM(controls.T), casadi.DM.ones(1, 7) * 0.03, quadrotor.gravity)
    np.testing.assert_allclose(np.array(gap), 0, atol=1e-13)


@pytest.mark.parametrize("name", ["ground-6", "hoop", "slalom"])
def test_bounds_and_guess_fit_the_program(name):
    scenario = SCENARIOS[name]
    steps = phase_steps(scenario)
    solver = program(steps, scenario.floor is not None, False)
    limits = bounds(scenario, steps, 1, False)
    assert len(limits["lbx"]) == len(limits["ubx"]) == len(first_guess(scenario, steps, 1)) == solver.size1_in("x0")
    assert len(limits["lbg"]) == len(limits["ubg"]) == solver.size1_out("g")
    assert np.all(limits["lbx"] <= limits["ubx"])
    assert np.all(limits["lbg"] <= limits["ubg"])
