"""`solve`: three methods agree; only a certified flight has a time."""

import math
from dataclasses import replace

import numpy as np
import pytest

import optimal
from experiments.measurements.sections import REFERENCE_TIMES
from flatgym import SCENARIOS, Hoop, Quadrotor
from optimal import SolveFailed, Status, certify
from optimal.direct.clearance import tighten
from optimal.direct.multistart import search


@pytest.mark.parametrize("name", ["horizontal-6", "ground-6"])
def test_shooting_and_the_flat_method_agree(name):
    shooting, flat = optimal.solve(name), optimal.solve(name, method="flat")
    assert shooting.status is flat.status is Status.SOLVED
    assert shooting.certificate.holds()
    assert flat.certificate.holds()
    assert 0 < flat.time / shooting.time - 1 < 3e-3
    share = np.linspace(0, 1, 50)
    ways = [s.trajectory(share * s.time) for s in (shooting, flat)]
    assert np.abs(ways[0] - ways[1]).max() < 0.1


def test_the_fastest_winding_is_returned_and_its_starts_are_counted():
    solution = optimal.solve("climb")
    assert abs(solution.winding) == 1
    assert abs(solution.time - 1.30037) < 5e-4
    # The costates of winding 0 prune windings of 2; the rotation alone excludes windings of 3.
    assert solution.starts == 9
    assert solution.agreed == 6  # windings 1 and -1
    more = optimal.solve("diagonal", windings=(0,), starts=4, seed=1)
    assert (more.starts, more.agreed) == (4, 4)


def test_pruning_windings_does_not_change_the_optimum():
    alone = [optimal.solve("hoop", windings=(winding,)).time for winding in (0, 3, -3)]
    assert optimal.solve("hoop").time == pytest.approx(min(alone), rel=1e-7)
    assert min(alone[1:]) > 6 * math.pi / SCENARIOS["hoop"].quadrotor.rate_max > alone[0]


# Twelve hoops take as long as all other scenarios.
@pytest.mark.parametrize("name", [name for name, task in SCENARIOS.items() if len(task.hoops) < 12])
def test_named_scenarios_are_solved_and_certified(name):
    solution = optimal.solve(name)
    assert solution.status is Status.SOLVED
    assert solution.reason == ""
    assert solution.certificate.holds()
    assert solution.certificate.max_control_violation == 0
    assert solution.agreed >= 2
    if name in REFERENCE_TIMES:
        assert abs(solution.time / REFERENCE_TIMES[name] - 1) < 2e-4


def test_limits_at_nodes_only_do_not_count_as_solved():
    lie = optimal.solve("horizontal-3", method="flat", checks="nodes")
    assert lie.status is Status.LIMITS_AT_NODES_ONLY
    assert not lie.solved
    assert not lie.certificate.holds()
    assert lie.certificate.max_control_violation > 1


def test_a_row_has_plain_values_in_order():
    row = optimal.solve("horizontal-3", windings=(0,)).row()
    first = ["scenario", "method", "time_s", "winding", "status", "iterations", "solve_time_s", "lower_bound_s"]
    assert list(row)[:8] == first
    assert row["gap"] == pytest.approx(row["time_s"] / row["lower_bound_s"] - 1)
    assert set(map(type, row.values())) <= {str, float, int}


def unreachable():
    """A goal beyond the longest phase that the solver considers."""
    return replace(SCENARIOS["diagonal"], goal=(4000.0, 0.0), time_limit=1000.0)


def test_a_failed_solve_has_a_reason_and_no_time():
    with pytest.raises(SolveFailed, match=r"did not converge.*takes at least 28.28 s") as failure:
        optimal.solve(unreachable(), windings=(0,))
    assert failure.value.problem == unreachable()
    solution = optimal.solve(unreachable(), windings=(0,), raise_on_failure=False)
    assert solution.time == math.inf
    assert solution.trajectory is None
    assert solution.status is Status.NOT_CONVERGED
    assert "too far" in solution.reason


def test_unknown_names_and_empty_searches_are_rejected():
    with pytest.raises(
        ValueError, match="unknown method 'flt'; known: shooting, flat, pontryagin; did you mean 'flat'"
    ):
        optimal.solve("hoop", method="flt")
    with pytest.raises(ValueError, match="unknown scenario 'hop'"):
        optimal.solve("hop")
    with pytest.raises(ValueError, match="at least one winding and one start"):
        optimal.solve("hoop", windings=())
    with pytest.raises(ValueError, match="intervals must be at least 4, got 0"):
        optimal.solve("horizontal-3", method="flat", intervals=0)
    with pytest.raises(ValueError, match="checks must be"):
        optimal.solve("horizontal-3", method="flat", checks="often")
    with pytest.raises(ValueError, match="shooting"):
        optimal.solve("hoop", method="pontryagin")


def test_shooting_and_the_indirect_method_agree():
    times = [optimal.solve("climb", method=method).time for method in ("shooting", "pontryagin")]
    assert abs(times[0] / times[1] - 1) < 1e-4
    assert times[1] <= times[0]


def test_a_scenario_outside_the_paper_gets_an_automatic_corridor():
    task = replace(SCENARIOS["horizontal-3"], hoops=(Hoop(1.5, 0.3, 0.8, 0.2),))
    flat, shooting = optimal.solve(task, method="flat"), optimal.solve(task)
    assert flat.status in (Status.SOLVED, Status.FEASIBLE)
    assert flat.certificate.holds()
    assert flat.time >= shooting.time * (1 - 1e-4)


@pytest.mark.parametrize(("name", "radius"), [("high-hoop", 0.1), ("hoop", 0.05), ("hoop", 0.1)])
def test_a_body_keeps_clear_of_the_rims_and_takes_longer(name, radius):
    body = replace(SCENARIOS[name], quadrotor=Quadrotor(radius=radius))
    narrow = replace(body.hoops[0], diameter=body.hoops[0].diameter - 2 * radius)
    point = optimal.solve(replace(SCENARIOS[name], hoops=(narrow,)))
    solution = optimal.solve(body)
    assert solution.status is Status.SOLVED
    assert solution.certificate.max_path_violation <= 1e-6
    assert point.time - 1e-6 < solution.time < 1.01 * point.time
    # The body would touch a rim on the flight of the point.
    assert optimal.certify(point.trajectory, body).max_path_violation > 1e-3


def test_limits_are_tightened_until_the_certificate_holds():
    # The flight through a gap that is 0.2 um wider violates the narrower gap by half of that.
    scenario = SCENARIOS["high-hoop"]
    plain = search(scenario.with_diameters([scenario.hoops[0].diameter + 2e-7])).shots[0]
    loose = certify(plain.trajectory, scenario)
    repaired, certificate = tighten(scenario, plain, loose)
    assert loose.hoop_clearance == pytest.approx(-1e-7, rel=0.01)
    assert not loose.holds()
    assert certificate.holds()
    assert repaired.trajectory.duration == pytest.approx(plain.trajectory.duration, rel=1e-6)
