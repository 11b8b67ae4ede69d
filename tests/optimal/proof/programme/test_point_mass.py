"""Pairs of passing times are left out only where all chains through them are negative."""

import numpy as np
import pytest

from flatgym import SCENARIOS
from optimal.direct.shooting import solve_coarse
from optimal.proof.branches import Branch
from optimal.proof.chain_terms import ChainTerms
from optimal.proof.dual import Dual
from optimal.proof.initial_multipliers import kink_shares, multipliers
from optimal.proof.programme.chain import best_through, best_values, reverse_time
from optimal.proof.programme.stations import Passing, Problem
from optimal.proof.programme.time_grid import time_grid


def duals():
    """Return duals of named tracks at times around that of a flight, with good multipliers and with disturbed ones."""
    generator = np.random.default_rng(3)
    for name in ("hoop", "slalom"):
        scenario = SCENARIOS[name]
        shot = solve_coarse(scenario)
        kinks = kink_shares(scenario, shot)
        y = multipliers(scenario, shot, kinks)
        for share in (0.8, 1.02):
            problem = Problem(scenario, None, share * shot.trajectory.duration, kinks)
            grid = time_grid(problem.duration, scenario.quadrotor.rate_max, turn=18)
            for winding in (None, shot.winding):
                dual = Dual(problem, grid, Branch(winding), problem.hoops, Passing.possible(problem))
                for noise in (0.0, 0.3) if dual.possible else ():
                    yield dual, y * (1 + noise * generator.normal(size=len(y)))


@pytest.fixture(scope="module")
def cases():
    return list(duals())


def all_left(dual: Dual, y: np.ndarray):
    """Return the terms of all chains, with every pair left."""
    chain, first = dual._chain(y)
    return chain._replace(left=np.ones_like(chain.left)), first


def greatest(dual: Dual, y: np.ndarray) -> np.ndarray:
    """Return the mean of both programmes over the best chains through each pair, with every pair left."""
    chain, first = all_left(dual, y)
    backward, backward_tilts = reverse_time(chain, dual._tilts, first)
    through = []
    for begin in (0, 1):
        dual.evaluate(y)
        values, past = np.empty_like(dual._values[begin]), np.empty_like(dual._values[begin])
        best_values(begin, chain, dual._tilts, dual._limits, values, np.empty_like(dual._choices[begin]))
        best_values(1 - begin, backward, backward_tilts, dual._limits, past, np.empty_like(dual._choices[begin]))
        through.append(best_through(begin, chain, dual._tilts, dual._limits, first, values, backward, past))
    return np.mean(through, axis=0) + dual._shared(y, chain)


def test_all_chains_through_a_pair_that_is_left_out_are_negative(cases):
    left_out = 0
    for dual, y in cases:
        left, total = dual._chain(y)[0].left, greatest(dual, y)
        possible = np.isfinite(total)
        assert (total[possible & ~left] < 0).all()
        left_out += np.count_nonzero(possible & ~left)
    assert left_out > 100


def test_the_bound_is_the_same_where_it_is_not_negative(cases, monkeypatch):
    found = [dual.evaluate(y).value for dual, y in cases]
    monkeypatch.setattr(Dual, "_chain", lambda self, y: _without(self, y))
    for (dual, y), value in zip(cases, found, strict=True):
        dual._last = None
        expected = dual.evaluate(y).value
        assert value == expected or (value < expected < 0)


def _without(dual: Dual, y: np.ndarray):
    chain, first = ChainTerms._chain(dual, y)
    return chain._replace(left=np.ones_like(chain.left)), first


def test_pairs_are_left_in_both_directions_of_time(cases):
    for dual, y in cases[:6]:
        chain, first = dual._chain(y)
        backward, tilts = reverse_time(chain, dual._tilts, first)
        again, _ = reverse_time(backward, tilts, chain.final)
        assert np.count_nonzero(backward.left) <= np.count_nonzero(chain.left)
        for i, (a, b) in enumerate(zip(dual._windows[:-1], dual._windows[1:], strict=True)):
            shape = tuple((high - low) // chain.stride + 1 for low, high in (a, b))
            np.testing.assert_array_equal(again.left[i, : shape[0], : shape[1]], chain.left[i, : shape[0], : shape[1]])


def test_nearly_all_pairs_of_a_time_that_is_much_too_short_are_left_out(cases):
    shares = [dual._chain(y)[0].left.mean() for dual, y in cases if dual.problem.scenario.name == "slalom"]
    assert shares[0] < 0.02
