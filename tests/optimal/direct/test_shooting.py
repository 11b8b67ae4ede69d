"""Shooting against the known optima, mirror symmetry, refinement, and the exact step as symbols."""

from itertools import pairwise

import casadi
import numpy as np
import pytest

from experiments.measurements.sections import REFERENCE_TIMES
from flatgym import SCENARIOS, Scenario
from optimal.direct.guesses import first_guess
from optimal.direct.program import Shape, bounds, constraints, phase_steps, program
from optimal.direct.shooting import solve_winding
from optimal.direct.stages import Stages
from optimal.direct.step_derivatives import step_functions
from optimal.direct.transcription import step_function

KNOWN = {name: time for name, time in REFERENCE_TIMES.items() if name != "climb"}
"""Those that make no turn [s]."""


@pytest.mark.parametrize(("name", "time"), KNOWN.items())
def test_known_optima_are_found_from_the_plain_start(name, time):
    shot = solve_winding(SCENARIOS[name])
    assert shot.converged
    assert abs(shot.trajectory.duration - time) < 5e-4


def test_a_flip_is_fastest_upwards():
    times = {winding: solve_winding(SCENARIOS["climb"], winding).trajectory.duration for winding in (0, 1, -1)}
    assert abs(times[1] - 1.30037) < 5e-4
    assert abs(times[1] - times[-1]) < 1e-6
    assert times[0] > times[1] + 0.01


def test_mirrored_scenarios_take_the_same_time():
    right, left = Scenario("right", (1, 2), (4, 4)), Scenario("left", (-1, 2), (-4, 4))
    for winding in (0, 1):
        there, mirrored = solve_winding(right, winding).trajectory, solve_winding(left, -winding).trajectory
        assert abs(there.duration - mirrored.duration) < 1e-6


def test_refining_the_grid_never_flies_slower_and_converges():
    times = [solve_winding(SCENARIOS["horizontal-6"], nodes=nodes).trajectory.duration for nodes in (25, 50, 100, 200)]
    # Halving every step keeps all old flights possible.
    assert all(fine <= coarse + 1e-7 for coarse, fine in pairwise(times))
    assert times[-2] - times[-1] < 1e-4


@pytest.mark.parametrize(("name", "winding"), [("diagonal", 0), ("climb", 1)])
def test_the_time_converges_at_second_order(name, winding):
    # Controls held over a step miss a switching time by up to a step, and the time is stationary there.
    nodes = (25, 50, 100, 200, 400)
    limit = solve_winding(SCENARIOS[name], winding, nodes=1600).trajectory.duration
    errors = [solve_winding(SCENARIOS[name], winding, nodes=n).trajectory.duration - limit for n in nodes]
    order = -np.polyfit(np.log(nodes), np.log(errors), 1)[0]
    assert 1.7 < order < 2.5


def test_random_starts_find_the_same_optimum(generator):
    times = [solve_winding(SCENARIOS["diagonal"], generator=generator).trajectory.duration for _ in range(3)]
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


@pytest.mark.parametrize(("name", "tolerant", "rims"), [("ground-6", False, False), ("slalom", True, True)])
def test_bounds_and_guess_fit_the_program(name, tolerant, rims):
    scenario = SCENARIOS[name]
    steps = phase_steps(scenario)
    shape = Shape(steps, scenario.floor is not None, tolerant, rims)
    solver, limits = program(shape), bounds(scenario, shape, 1)
    assert len(limits["lbx"]) == len(limits["ubx"]) == len(first_guess(scenario, steps, 1)) == solver.size1_in("x0")
    assert len(limits["lbg"]) == len(limits["ubg"]) == solver.size1_out("g")
    assert len(limits["p"]) == solver.size1_in("p")
    assert np.all(limits["lbx"] <= limits["ubx"])
    assert np.all(limits["lbg"] <= limits["ubg"])
    assert constraints(shape) == sorted(constraints(shape))


def test_every_unknown_of_the_stages_has_one_place():
    stages = Stages((3, 2))
    places = [stages.states.ravel(), stages.arrivals, stages.controls.ravel(), stages.lengths]
    np.testing.assert_array_equal(np.sort(np.concatenate(places)), np.arange(stages.size))
    lengths = np.array([0.1, 0.2])
    unknowns = stages.pack(lengths, np.ones((6, 5)), np.ones((5, 2)))
    np.testing.assert_array_equal(unknowns[stages.departures], np.repeat(lengths, (3, 2)))


def test_the_mapped_step_and_its_derivatives_are_those_of_the_exact_step(generator):
    step, jacobian, hessian = step_functions()
    arc, costate = casadi.SX.sym("arc", 8), casadi.SX.sym("l", 5)
    exact = step_function()(arc[:5], arc[6:], arc[5], 9.81)
    curvature = casadi.hessian(costate.T @ exact, arc)[0]
    reference = casadi.Function("r", [arc, costate], [exact, casadi.jacobian(exact, arc), curvature])
    for rate in (0.0, 3.0, -10.0):
        values = np.array([*generator.normal(size=5), 0.08, generator.uniform(1, 20), rate])
        weights = generator.normal(size=5)
        wanted = [np.array(value) for value in reference(values, weights)]
        found = [step(values, 9.81), jacobian(values, 9.81)[1], hessian(values, 9.81, weights)[1]]
        for mine, theirs in zip(found, wanted, strict=True):
            np.testing.assert_allclose(np.array(mine), theirs, atol=1e-13)


@pytest.mark.parametrize("name", ["hoop", "ground-6"])
def test_derivatives_of_the_program_are_those_of_its_constraints(name, generator):
    scenario = SCENARIOS[name]
    shape = Shape((3,) * (1 + len(scenario.hoops)), scenario.floor is not None, True, rims=True)
    solver = program(shape)
    x, p, lam = (generator.normal(size=solver.size1_in(i)) for i in ("x0", "p", "lam_g0"))
    jacobian, (_, hessian) = solver.get_function("nlp_jac_g")(x, p)[1], solver.get_function("nlp_hess_l")(x, p, 0, lam)
    constraint = solver.get_function("nlp_g")
    for direction in generator.normal(size=(3, len(x))):
        ends = [np.array(constraint(x + s * 1e-6 * direction, p)).ravel() for s in (1, -1)]
        np.testing.assert_allclose(np.array(jacobian @ direction).ravel(), (ends[0] - ends[1]) / 2e-6, atol=1e-6)
        slopes = [np.array(solver.get_function("nlp_jac_g")(x + s * 1e-6 * direction, p)[1]).T @ lam for s in (1, -1)]
        np.testing.assert_allclose(np.array(hessian @ direction).ravel(), (slopes[0] - slopes[1]) / 2e-6, atol=1e-5)


def test_costates_of_the_position_are_constant_and_those_of_the_velocity_linear():
    costates = solve_winding(SCENARIOS["horizontal-6"]).costates
    np.testing.assert_allclose(costates[:, :2], costates[:1, :2].repeat(100, axis=0), atol=1e-7)
    np.testing.assert_allclose(np.diff(costates[:, 2:4], n=2, axis=0), 0, atol=1e-7)


def test_a_start_from_which_nothing_converges_says_so():
    shot = solve_winding(Scenario("far", (0, 0), (4000, 0)))
    assert not shot.converged
    assert shot.message != "SOLVER_RET_SUCCESS"
