"""Branches from any halvings cover all flights, and a missing branch is detected."""

import math

import numpy as np
import pytest

from optimal.proof.branches import Branch, TiltInterval, covered

SHARES = (0.25, 0.5, 0.75)
REACH = (-4.0, 4.0)


def grown(generator, windows, halvings) -> list[Branch]:
    """Return the leaves of a tree of random halvings."""
    leaves = [Branch(0, tuple(windows))]
    for _ in range(halvings):
        leaf = leaves.pop(int(generator.integers(len(leaves))))
        kind = int(generator.integers(len(windows) + len(SHARES)))
        if kind < len(windows):
            leaves += leaf.halve_passing(kind)
        else:
            leaves += leaf.halve_tilt(SHARES[kind - len(windows)], REACH)
    return leaves


def belongs(branch: Branch, passing, tilts) -> bool:
    """Return whether a flight with these passing times and tilts at SHARES belongs to a branch."""
    return all(low <= time <= high for time, (low, high) in zip(passing, branch.passing, strict=True)) and all(
        held.low <= tilts[SHARES.index(held.share)] <= held.high for held in branch.held
    )


@pytest.mark.parametrize("hoops", [0, 1, 3])
def test_repeated_halvings_cover_all_flights_and_a_missing_branch_is_detected(hoops, generator):
    for halvings in (0, 1, 2, 5, 12):
        windows = [tuple(sorted(generator.uniform(0, 1, 2).tolist())) for _ in range(hoops)]
        leaves = grown(generator, windows, halvings)
        assert len(leaves) == halvings + 1
        generator.shuffle(leaves)
        assert covered(leaves, windows)
        for i in range(len(leaves)):
            assert not covered(leaves[:i] + leaves[i + 1 :], windows)


def test_every_flight_belongs_to_a_leaf(generator):
    windows = [(0.1, 0.4), (0.3, 0.9)]
    leaves = grown(generator, windows, 40)
    for _ in range(300):
        passing = [generator.uniform(*window) for window in windows]
        tilts = generator.normal(scale=10, size=len(SHARES))  # also beyond REACH
        assert any(belongs(leaf, passing, tilts) for leaf in leaves)


def test_irregular_covers_agree_with_a_test_of_every_cell(generator):
    # Boxes with corners on a lattice cover the whole if and only if each cell's midpoint lies in one of them.
    cells = np.stack(np.meshgrid(np.arange(3) + 0.5, np.arange(3) + 0.5), axis=-1).reshape(-1, 2)
    expectations = []
    for _ in range(400):
        branches = []
        for _ in range(int(generator.integers(1, 7))):
            (a, b), (c, d) = (np.sort(generator.choice(4, 2, replace=False)).tolist() for _ in range(2))
            low, high = (-math.inf if c == 0 else c), (math.inf if d == 3 else d)
            branches.append(Branch(0, ((a, b),), (TiltInterval(0.5, low, high),)))
        expected = all(
            any(b.passing[0][0] < x < b.passing[0][1] and b.held[0].low < y < b.held[0].high for b in branches)
            for x, y in cells
        )
        assert covered(branches, [(0.0, 3.0)]) is expected
        expectations.append(expected)
    assert 0.05 < np.mean(expectations) < 0.95


def test_wider_branches_cover_and_narrower_ones_do_not():
    windows = [(0.2, 0.6)]
    assert covered([Branch(1, ((0.0, 1.0),))], windows)
    assert covered([Branch(1, ((0.0, 0.5),)), Branch(1, ((0.4, 1.0),))], windows)
    assert not covered([Branch(1, ((0.0, 0.4),)), Branch(1, ((0.41, 1.0),))], windows)
    assert not covered([Branch(1, ((0.2, 0.59),))], windows)
    assert not covered([], windows)
    assert not covered([], [])
    assert covered([Branch(1)], [])
    # A tilt bounded on both sides does not cover the tilts outside.
    assert not covered([Branch(1, (), (TiltInterval(0.5, -9.0, 9.0),))], [])


def test_tilts_are_halved_within_the_reachable_range_and_stay_unbounded_outwards():
    first, second = Branch(0).halve_tilt(0.5, (-1.0, 3.0))
    assert first.held == (TiltInterval(0.5, -math.inf, 1.0),)
    assert second.held == (TiltInterval(0.5, 1.0, math.inf),)
    # A second halving intersects the first. Another instant is independent.
    assert [half.held for half in second.halve_tilt(0.5, (-1.0, 3.0))] == [
        (TiltInterval(0.5, 1.0, 2.0),),
        (TiltInterval(0.5, 2.0, math.inf),),
    ]
    assert first.halve_tilt(0.25, (-1.0, 1.0))[0].held == (
        TiltInterval(0.5, -math.inf, 1.0),
        TiltInterval(0.25, -math.inf, 0.0),
    )


def test_passing_times_are_halved_hoop_by_hoop():
    halves = Branch(2, ((0.0, 0.5), (0.5, 1.0))).halve_passing(1)
    assert halves == [Branch(2, ((0.0, 0.5), (0.5, 0.75))), Branch(2, ((0.0, 0.5), (0.75, 1.0)))]
