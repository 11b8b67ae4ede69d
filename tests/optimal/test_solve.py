"""The front door: two roads, one number; what is not solved has no time."""

import math
from dataclasses import replace

import numpy as np
import pytest

import optimal
from flatgym import SCENARIOS, Hoop, Quadrotor
from optimal import SolveFailed, Status


@pytest.mark.parametrize("name", ["horizontal-6", "ground-6"])
def test_two_independent_roads_agree(name):
    shooting, flat = optimal.solve(name), optimal.solve(name, method="flat")
    assert shooting.status is flat.status is Status.SOLVED
    assert shooting.certificate.holds()
    assert flat.certificate.holds()
    assert 0 < flat.time / shooting.time - 1 < 3e-3
    share = np.linspace(0, 1, 50)
    ways = [s.trajectory(share * s.time) for s in (shooting, flat)]
    assert np.abs(ways[0] - ways[1]).max() < 0.1


def test_the_fastest_winding_wins_and_its_starts_are_counted():
    solution = optimal.solve("climb")
    assert abs(solution.winding) == 1
    assert abs(solution.time - 1.30037) < 5e-4
    assert solution.starts == 5
    assert solution.agreed == 2  # one turn either way
    more = optimal.solve("diagonal", windings=(0,), starts=3, seed=1)
    assert (more.starts, more.agreed) == (3, 3)


def test_limits_at_nodes_only_are_never_called_solved():
    lie = optimal.solve("horizontal-3", method="flat", checks="nodes")
    assert lie.status is Status.LIMITS_AT_NODES_ONLY
    assert not lie.solved
    assert not lie.certificate.holds()
    assert lie.certificate.max_control_violation > 1


def test_a_row_is_plain_and_complete():
    row = optimal.solve("horizontal-3", windings=(0,)).row()
    first = ["scenario", "method", "time_s", "winding", "status", "iterations", "solve_time_s", "lower_bound_s"]
    assert list(row)[:8] == first
    assert row["gap"] == pytest.approx(row["time_s"] / row["lower_bound_s"] - 1)
    assert set(map(type, row.values())) <= {str, float, int}


def unreachable():
    """A goal so far away that no phase the solver considers is long enough."""
    return replace(SCENARIOS["diagonal"], goal=(4000.0, 0.0), time_limit=1000.0)


def test_what_does_not_converge_has_a_sentence_and_no_time():
    with pytest.raises(SolveFailed, match="did not converge") as failure:
        optimal.solve(unreachable(), windings=(0,))
    assert failure.value.problem == unreachable()
    solution = optimal.solve(unreachable(), windings=(0,), throw=False)
    assert solution.time == math.inf
    assert solution.trajectory is None
    assert solution.status is Status.NOT_CONVERGED


def test_unknown_words_and_empty_searches_are_refused():
    with pytest.raises(ValueError, match="unknown method 'flt'; known: shooting, flat; did you mean 'flat'"):
        optimal.solve("hoop", method="flt")
    with pytest.raises(ValueError, match="unknown scenario 'hop'"):
        optimal.solve("hop")
    with pytest.raises(ValueError, match="at least one winding and one start"):
        optimal.solve("hoop", windings=())
    with pytest.raises(ValueError, match="checks must be"):
        optimal.solve("horizontal-3", method="flat", checks="often")
    with pytest.raises(ValueError, match="prints no outer paths"):
        optimal.solve(replace(SCENARIOS["diagonal"], hoops=(Hoop(2, 1, 0.5),)), method="flat")


def test_a_slower_certified_flight_is_not_called_the_optimum():
    # The fastest flight grazes the rim; others, slower by a sixth, do not.
    body = replace(SCENARIOS["high-hoop"], quadrotor=Quadrotor(radius=0.1))
    solution = optimal.solve(body, throw=False)
    assert solution.status is Status.NOT_CERTIFIED
    assert solution.time == math.inf
    assert solution.certificate.max_path_violation > 1e-3
