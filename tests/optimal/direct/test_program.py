"""The shooting program: bounds and guesses fit it, its derivatives match finite differences."""

import numpy as np
import pytest

from flatgym import SCENARIOS
from optimal.direct.guesses import first_guess
from optimal.direct.program import Shape, bounds, constraints, phase_steps, program
from optimal.direct.transcription import geometry


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


@pytest.mark.parametrize("name", ["hoop", "ground-6"])
def test_derivatives_match_finite_differences(name, generator):
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


@pytest.mark.parametrize("name", ["slalom", "loop", "climb"])
def test_the_geometry_of_a_scenario_is_computed_once_and_read_only(name):
    scenario = SCENARIOS[name]
    arrays = geometry(scenario)
    assert geometry(scenario) is arrays
    for hoop, column, rims in zip(scenario.hoops, arrays.hoops.T, arrays.rims.T, strict=True):
        np.testing.assert_array_equal(column, [*hoop.centre, *hoop.direction])
        np.testing.assert_array_equal(rims.reshape(2, 2), hoop.rims)
    assert arrays.lengths.sum() >= np.hypot(*np.subtract(scenario.goal, scenario.start))
    with pytest.raises(ValueError, match="read-only"):
        arrays.points[0] = 1.0
