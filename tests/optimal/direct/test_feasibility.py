"""Infeasibility: proofs before the solve, a diagnosis after a failed one."""

import math
from dataclasses import replace

import pytest

import optimal
from flatgym import SCENARIOS, Hoop, Quadrotor, Scenario
from optimal import SolveFailed, Status
from optimal.direct.feasibility import beyond_horizon, infeasibility_proof, infeasibility_suspect, passage


def gate(second, radius=0.15, **limits):
    """Two hoops in one wall, the first around the origin's height."""
    hoops = (Hoop(2.5, 0.0, 0.5), second)
    return Scenario("gate", (0, 0), (5, 0), hoops=hoops, quadrotor=Quadrotor(radius=radius), **limits)


@pytest.mark.parametrize("name", SCENARIOS)
def test_named_scenarios_are_feasible_for_points_and_small_bodies(name):
    for radius in (0.0, 0.1):
        scenario = replace(SCENARIOS[name], quadrotor=Quadrotor(radius=radius))
        assert infeasibility_proof(scenario) == beyond_horizon(scenario) == ""
        for i, hoop in enumerate(scenario.hoops):
            half = hoop.diameter / 2 - radius
            assert passage(scenario, i) == [(pytest.approx(-half), pytest.approx(half))]


def test_rims_of_other_hoops_reduce_the_passage():
    # The lower rim of the second hoop stands at z = -0.05 m, a disc of 0.15 m around it.
    assert passage(gate(Hoop(2.5, 0.3, 0.7), radius=0.1), 0) == [(pytest.approx(0.05), pytest.approx(0.15))]
    assert passage(gate(Hoop(2.5, 0.3, 0.7), radius=0.0), 0) == [(-0.25, 0.25)]
    assert passage(gate(Hoop(2.5, 0.2, 0.5)), 0) == []


def test_floor_and_ceiling_reduce_the_passage_in_either_direction():
    for angle in (0.0, math.pi):
        scenario = replace(SCENARIOS["hoop"], hoops=(Hoop(2.5, 2.5, 0.5, angle),), floor=0.0, ceiling=5.0)
        assert passage(scenario, 0) == [(-0.25, 0.25)]
    low = Scenario("low", (0, 0), (5, 0), hoops=(Hoop(2.5, 0.1, 0.5),), floor=0.0)
    assert passage(low, 0) == [(pytest.approx(-0.1), 0.25)]


def test_a_blocked_gap_is_reported_before_the_solve_with_its_hoop():
    blocked = gate(Hoop(2.5, 0.2, 0.5))
    with pytest.raises(SolveFailed, match=r"no flight of this scenario exists.*hoops\[0\] cannot be passed.*0\.15 m"):
        optimal.solve(blocked)
    solution = optimal.solve(blocked, raise_on_failure=False)
    assert solution.status is Status.INFEASIBLE
    assert (solution.time, solution.trajectory, solution.starts) == (math.inf, None, 0)
    steps = optimal.fewest_steps(blocked, raise_on_failure=False)
    assert steps.status is Status.INFEASIBLE
    assert steps.reason == solution.reason


def test_a_flat_hoop_at_the_ceiling_is_infeasible():
    flat = replace(SCENARIOS["hoop"], ceiling=6.0, hoops=(Hoop(2.5, 6.0, 0.5, math.pi / 2),))
    assert "against the ceiling" in infeasibility_proof(flat)
    assert infeasibility_proof(replace(flat, ceiling=6.5)) == ""


def test_a_goal_beyond_the_horizon_is_reported_with_its_least_time():
    far = replace(SCENARIOS["diagonal"], goal=(4000.0, 0.0), time_limit=1000.0)
    assert "at least 28.28 s" in beyond_horizon(far)
    weak = replace(SCENARIOS["diagonal"], quadrotor=Quadrotor(thrust_max=9.811))
    assert beyond_horizon(weak)


def test_the_requirement_whose_removal_lets_the_solver_converge_is_the_suspect(monkeypatch):
    scenario = replace(SCENARIOS["slalom"], floor=-3.0)
    guilty = scenario.hoops[1]

    class Answer:
        def __init__(self, easier):
            self.converged = guilty not in easier.hoops

    monkeypatch.setattr("optimal.direct.feasibility.solve_coarse", Answer)
    assert f"without hoops[1] = {guilty}" in infeasibility_suspect(scenario)
    monkeypatch.setattr("optimal.direct.feasibility.solve_coarse", lambda _: Answer(scenario))
    assert "even without" in infeasibility_suspect(scenario)
