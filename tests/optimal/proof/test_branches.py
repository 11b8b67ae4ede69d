"""Branches from any halvings cover all flights, and a missing branch is detected."""

import math

import pytest

from optimal.proof.branches import Branch, TiltInterval, covered

SHARES = (0.25, 0.5, 0.75)
REACH = (-4.0, 4.0)


def grown(generator, halvings) -> list[Branch]:
    """Return the leaves of a tree of random halvings."""
    leaves = [Branch(0)]
    for _ in range(halvings):
        leaf = leaves.pop(int(generator.integers(len(leaves))))
        leaves += leaf.halve_tilt(SHARES[int(generator.integers(len(SHARES)))], REACH)
    return leaves


@pytest.mark.parametrize("halvings", [0, 1, 2, 5, 12])
def test_repeated_halvings_cover_all_flights_and_a_missing_branch_is_detected(halvings, generator):
    leaves = grown(generator, halvings)
    assert len(leaves) == halvings + 1
    generator.shuffle(leaves)
    assert covered(leaves, [0])
    for i in range(len(leaves)):
        assert not covered(leaves[:i] + leaves[i + 1 :], [0])


def test_every_flight_belongs_to_a_leaf(generator):
    leaves = grown(generator, 40)
    for _ in range(300):
        tilts = generator.normal(scale=10, size=len(SHARES))  # also beyond REACH
        assert any(
            all(held.low <= tilts[SHARES.index(held.share)] <= held.high for held in leaf.held) for leaf in leaves
        )


def test_the_branch_of_all_flights_covers_all_windings():
    assert covered([Branch()], range(-3, 4))
    assert not covered([], [0])
    assert not covered([Branch(0), Branch(2)], [0, 1, 2])
    assert covered([Branch(0), Branch(2)], [0, 2])
    assert not covered([Branch(None, (TiltInterval(0.5, -9.0, 9.0),))], [0])


def test_a_tilt_bounded_on_both_sides_does_not_cover_the_tilts_outside():
    assert not covered([Branch(1, (TiltInterval(0.5, -9.0, 9.0),))], [1])
    inside, outside = TiltInterval(0.5, -math.inf, 1.0), TiltInterval(0.5, 1.0, math.inf)
    assert covered([Branch(1, (inside,)), Branch(1, (outside,))], [1])
    # Two bounds at one instant are intersected.
    assert not covered([Branch(1, (inside, TiltInterval(0.5, 0.0, 2.0))), Branch(1, (outside,))], [1])


def test_tilts_are_halved_within_the_reachable_range_and_stay_unbounded_outwards():
    first, second = Branch(0).halve_tilt(0.5, (-1.0, 3.0))
    assert first.held == (TiltInterval(0.5, -math.inf, 1.0),)
    assert second.held == (TiltInterval(0.5, 1.0, math.inf),)
    assert [half.held for half in second.halve_tilt(0.5, (-1.0, 3.0))] == [
        (TiltInterval(0.5, 1.0, 2.0),),
        (TiltInterval(0.5, 2.0, math.inf),),
    ]
