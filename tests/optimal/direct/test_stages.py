"""Programs in stages: places of the unknowns; the symbolic step and its derivatives equal the numeric step."""

import casadi
import numpy as np

from optimal.direct.stages import Stages
from optimal.direct.step_derivatives import step_functions
from optimal.direct.transcription import step_function


def test_every_unknown_has_exactly_one_place():
    stages = Stages((3, 2))
    places = [stages.states.ravel(), stages.arrivals, stages.controls.ravel(), stages.lengths]
    np.testing.assert_array_equal(np.sort(np.concatenate(places)), np.arange(stages.size))
    lengths = np.array([0.1, 0.2])
    unknowns = stages.pack(lengths, np.ones((6, 5)), np.ones((5, 2)))
    np.testing.assert_array_equal(unknowns[stages.departures], np.repeat(lengths, (3, 2)))


def test_further_unknowns_stand_at_the_end_of_their_stages():
    stages = Stages((3, 2), (1, 4, 1, 5))
    places = [stages.states.ravel(), stages.arrivals, stages.controls.ravel(), stages.lengths, stages.further]
    np.testing.assert_array_equal(np.sort(np.concatenate(places)), np.arange(stages.size))
    for stage, place in zip(stages.extras, stages.further, strict=True):
        assert stages.controls[min(stage, 4)].max() < place < stages.begins[stage + 1]
    further = np.array([0.1, 0.2, 0.3, 0.4])
    unknowns = stages.pack(np.ones(2), np.ones((6, 5)), np.ones((5, 2)), further)
    np.testing.assert_array_equal(unknowns[stages.further], further)


def test_the_symbolic_step_equals_the_numeric_step(generator, quadrotor):
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


def test_the_mapped_step_and_its_derivatives_equal_those_of_the_exact_step(generator):
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
