"""The program of K steps: bounds and guess fit it, its derivatives match finite differences."""

import numpy as np
import pytest

from flatgym import SCENARIOS
from optimal.direct import program as direct
from optimal.direct.shooting import solve_coarse
from optimal.discrete import program as discrete

SHAPES = {
    "ground-6": discrete.StepShape(5, limited=True),
    "hoop": discrete.StepShape(6, limited=False, crossings=(2,), rims=True),
}


@pytest.mark.parametrize("name", SHAPES)
def test_bounds_and_guess_fit_the_program(name):
    scenario, shape = SCENARIOS[name], SHAPES[name]
    solver, limits = discrete.program(shape), discrete.bounds(scenario, shape, 1)
    guess = discrete.first_guess(scenario, solve_coarse(scenario).trajectory, shape.steps)
    assert len(limits["lbx"]) == len(limits["ubx"]) == len(guess) == solver.size1_in("x0")
    assert len(limits["lbg"]) == len(limits["ubg"]) == solver.size1_out("g")
    assert len(limits["p"]) == solver.size1_in("p")
    assert np.all(limits["lbx"] <= limits["ubx"])
    assert np.all(limits["lbg"] <= limits["ubg"])


@pytest.mark.parametrize("name", SHAPES)
def test_derivatives_match_finite_differences(name, generator):
    scenario, shape = SCENARIOS[name], SHAPES[name]
    solver = discrete.program(shape)
    x = discrete.first_guess(scenario, solve_coarse(scenario).trajectory, shape.steps)
    p, lam = discrete.bounds(scenario, shape, 0)["p"], generator.normal(size=solver.size1_out("g"))
    jacobian, (_, hessian) = solver.get_function("nlp_jac_g")(x, p)[1], solver.get_function("nlp_hess_l")(x, p, 0, lam)
    for direction in generator.normal(size=(3, len(x))):
        ends = [x + sign * 1e-6 * direction for sign in (1, -1)]
        values = [np.array(solver.get_function("nlp_g")(end, p)).ravel() for end in ends]
        slopes = [np.array(solver.get_function("nlp_jac_g")(end, p)[1]).T @ lam for end in ends]
        for derivative, (above, below) in ((jacobian, values), (hessian, slopes)):
            difference = (above - below) / 2e-6
            error = np.array(derivative @ direction).ravel() - difference
            assert np.abs(error).max() <= 1e-6 * max(1.0, np.abs(difference).max())


def test_both_programs_share_the_constraints_of_heights_and_rims():
    assert direct.KINDS.keys() == discrete.KINDS.keys()
    shared = {kind for kind in direct.KINDS if direct.KINDS[kind] is discrete.KINDS[kind]}
    assert shared == {"rise", "fall", "rims"}
