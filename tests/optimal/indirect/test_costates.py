"""The costate report of direct solutions: small for optima, decreasing with the step, and large otherwise."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from flatgym import SCENARIOS, Quadrotor
from optimal.direct.shooting import solve_winding
from optimal.indirect.arcs import arcs_of, merged_arcs
from optimal.indirect.costates import CostateReport, hamiltonian, misalignment, report, signs_agree
from optimal.indirect.pontryagin import pontryagin

FLOWN = [("horizontal-6", 0), ("diagonal", 0), ("climb", 1), ("hoop", 0), ("ground-6", 0)]


@cache
def shot(name, winding=0, nodes=100):
    return solve_winding(SCENARIOS[name], winding, nodes=nodes)


@pytest.mark.parametrize(("name", "winding"), FLOWN)
def test_conditions_hold_better_with_shorter_steps(name, winding):
    coarse, fine = (report(shot(name, winding, nodes), SCENARIOS[name]) for nodes in (50, 200))
    assert fine.hamiltonian_drift < 0.6 * coarse.hamiltonian_drift < 0.06
    assert fine.singular_residual < 0.6 * coarse.singular_residual < 0.01
    assert fine.switching_agreement > 0.98


@pytest.mark.parametrize(("name", "winding"), FLOWN)
def test_the_hamiltonian_is_one(name, winding):
    found = shot(name, winding)
    flight = found.trajectory
    values = hamiltonian(flight.states[1:], flight.controls, found.costates, flight.quadrotor)
    assert values.mean() == pytest.approx(1.0, abs=1e-6)


def test_costates_of_another_flight_are_detected():
    found, scenario = shot("horizontal-6"), SCENARIOS["horizontal-6"]
    good = report(found, scenario)
    for wrong in (
        replace(found, costates=found.costates[::-1]),
        replace(found, costates=found.costates * [1, 1, -1, 1, 1]),
        replace(found, trajectory=shot("diagonal").trajectory),
    ):
        bad = report(wrong, scenario)
        assert bad.hamiltonian_drift > 100 * good.hamiltonian_drift
        assert bad.switching_agreement < 0.9


def test_a_slower_flight_is_detected():
    # The optimum under weaker limits is another flight, which is not optimal under the true limits.
    scenario = SCENARIOS["horizontal-6"]
    weak = solve_winding(replace(scenario, quadrotor=Quadrotor(thrust_max=18.0)))
    assert report(weak, scenario).switching_agreement == 0.0
    slow = solve_winding(replace(scenario, quadrotor=Quadrotor(rate_max=8.0)))
    assert report(slow, scenario).singular_residual > 0.05


def test_the_report_of_an_unconverged_solution_is_infinite():
    nothing = report(replace(shot("horizontal-6"), converged=False), SCENARIOS["horizontal-6"])
    assert nothing == CostateReport(math.inf, 0.0, math.inf)


def test_costates_must_fit_the_steps():
    found = shot("horizontal-6")
    with pytest.raises(ValueError, match=r"costates of shape \(100, 5\), got \(99, 5\)"):
        report(replace(found, costates=found.costates[1:]), SCENARIOS["horizontal-6"])


def test_signs_and_angles_are_those_of_the_hamiltonian(generator, quadrotor):
    # Of all controls, those whose signs agree make H greatest.
    for _ in range(50):
        state, costate = generator.normal(size=5), generator.normal(size=5)
        corners = np.array([[f, w] for f in (1.0, 20.0) for w in (-10.0, 10.0)])
        values = hamiltonian(state, corners, costate, quadrotor)
        agree = signs_agree(np.tile(state, (4, 1)), corners, np.tile(costate, (4, 1)), quadrotor)
        assert agree.tolist() == (np.arange(4) == values.argmax()).tolist()
        turned = np.append(state[:4], state[4] + misalignment(state, costate))
        assert abs(misalignment(turned, costate)) < 1e-12


def test_the_structure_of_the_direct_solution_is_close_to_the_extremal():
    structure, guess = arcs_of(shot("horizontal-6"))
    extremal = pontryagin(SCENARIOS["horizontal-6"])
    assert structure == ((20.0, 10.0), (20.0, None), (20.0, -10.0), (20.0, None), (20.0, 10.0))
    np.testing.assert_allclose(guess[:5], [arc.end - arc.start for arc in extremal.switches], atol=0.03)
    np.testing.assert_allclose(guess[5:], [*extremal.q0, *extremal.q1], atol=1e-3)


def test_merged_arcs_change_one_control_at_a_time():
    pieces = [((20.0, 10.0), 0.1), ((20.0, 10.0), 0.2), ((20.0, None), 0.4), ((1.0, -10.0), 0.8)]
    structure, durations = merged_arcs(pieces)
    assert structure == ((20.0, 10.0), (20.0, None), (20.0, -10.0), (1.0, -10.0))
    assert durations == pytest.approx([0.3, 0.4, 0.1, 0.8])
    structure, durations = merged_arcs([((1.0, 10.0), 0.4), ((20.0, None), 0.8)])
    assert structure == ((1.0, 10.0), (20.0, 10.0), (20.0, None))
