"""The program of K steps: bounds and guess fit it, its derivatives match finite differences, every solve returns."""

import math

import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Scenario
from optimal.direct import program as direct
from optimal.direct.shooting import solve_coarse
from optimal.direct.stage_solver import LARGEST_DERIVATIVE
from optimal.discrete import program as discrete
from optimal.discrete.fixed_steps import crossing_steps

SHAPES = {
    "ground-6": discrete.StepShape(5, limited=True),
    "hoop": discrete.StepShape(6, limited=False, crossings=(2,), rims=True),
}


@pytest.mark.parametrize("name", SHAPES)
def test_bounds_and_guess_fit_the_program(name):
    scenario, shape = SCENARIOS[name], SHAPES[name]
    solver, limits = discrete.program(shape), discrete.bounds(scenario, shape, 1)
    guess = discrete.first_guess(scenario, solve_coarse(scenario).trajectory, shape)
    assert len(limits["lbx"]) == len(limits["ubx"]) == len(guess) == solver.size1_in("x0")
    assert len(limits["lbg"]) == len(limits["ubg"]) == solver.size1_out("g")
    assert len(limits["p"]) == solver.size1_in("p")
    assert np.all(limits["lbx"] <= limits["ubx"])
    assert np.all(limits["lbg"] <= limits["ubg"])


@pytest.mark.parametrize("name", SHAPES)
def test_derivatives_match_finite_differences(name, generator):
    scenario, shape = SCENARIOS[name], SHAPES[name]
    solver = discrete.program(shape)
    x = discrete.first_guess(scenario, solve_coarse(scenario).trajectory, shape)
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


@pytest.mark.parametrize("size", [1.0, 1e30, np.nan])
def test_derivatives_are_finite_and_bounded_everywhere(size, generator):
    # The solver never returns from a matrix that is not finite.
    solver = discrete.program(SHAPES["hoop"])
    x, lam = (size * generator.normal(size=solver.size1_in(i)) for i in ("x0", "lam_g0"))
    p = discrete.bounds(SCENARIOS["hoop"], SHAPES["hoop"], 0)["p"]
    jacobian, (_, hessian) = solver.get_function("nlp_jac_g")(x, p)[1], solver.get_function("nlp_hess_l")(x, p, 0, lam)
    for matrix in (jacobian, hessian):
        assert np.abs(matrix.nonzeros()).max() <= LARGEST_DERIVATIVE


THERE_AND_BACK = (Hoop(2.5, 0, 1), Hoop(2.5, 0, 1, math.pi))
CROWDED = {
    "two facing hoops": THERE_AND_BACK,
    "back first": THERE_AND_BACK[::-1],
    "one hoop twice": (Hoop(2.5, 0, 1), Hoop(2.5, 0, 1)),
    "1 mm apart": (Hoop(2.5, 0, 1), Hoop(2.501, 0, 1)),
    "at the start": (Hoop(0, 0, 1),),
    "back at the start": (Hoop(0, 0, 1, math.pi),),
}


@pytest.mark.parametrize("name", CROWDED)
def test_every_solve_returns_and_its_crossings_lie_on_the_hoops_lines(name, generator):
    target = Scenario("crowded", (0, 0), (5, 0), hoops=CROWDED[name], time_limit=10)
    flight, converged = solve_coarse(target).trajectory, 0
    for _ in range(15):
        count = math.ceil(flight.duration / target.dt) + int(generator.integers(-6, 6))
        moved = np.array(crossing_steps(target, flight, count)) + generator.integers(-2, 5, len(target.hoops))
        crossings = tuple(moved.clip(min=0).tolist())
        shape = discrete.StepShape(count, limited=False, crossings=crossings)
        found = discrete.solve_program(target, shape, 0, discrete.first_guess(target, flight, shape))
        if math.isinf(found.m):
            continue
        converged += 1
        states = target.quadrotor.fly(target.start_state, found.controls, target.dt)
        for hoop, j, share in zip(target.hoops, crossings, found.shares, strict=True):
            state = target.quadrotor.step(states[j], found.controls[j], share * target.dt)
            assert abs((state[:2] - hoop.centre) @ hoop.direction) < 1e-6
            assert abs((state[:2] - hoop.centre) @ hoop.across) < hoop.diameter / 2
            assert state[2:4] @ hoop.direction > 0
    assert converged > 0
