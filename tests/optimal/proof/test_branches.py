"""Branches from any halvings cover all flights, and a missing branch is detected."""

import math

import pytest

from optimal.proof.branches import Branch, PassingInterval, TiltInterval, covered

SHARES = (0.25, 0.5, 0.75)
HOOPS = 2


def grown(generator, splits) -> list[Branch]:
    """Return the leaves of a tree of random splits, in which every leaf contains flights."""
    leaves = [Branch(0)]
    while len(leaves) <= splits:
        leaf = leaves.pop(int(generator.integers(len(leaves))))
        if generator.random() < 0.5:
            parts = leaf.split_tilt(SHARES[int(generator.integers(len(SHARES)))], float(generator.normal(scale=3)))
        else:
            parts = leaf.split_passing(int(generator.integers(HOOPS)), float(generator.random()))
        proper = all(low < high for part in parts for _, low, high in (*part.held, *part.passing))
        leaves += parts if proper else [leaf]
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
        tilts, times = generator.normal(scale=10, size=len(SHARES)), generator.random(HOOPS)
        assert any(
            all(held.low <= tilts[SHARES.index(held.share)] <= held.high for held in leaf.held)
            and all(passing.low <= times[passing.hoop] <= passing.high for passing in leaf.passing)
            for leaf in leaves
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


def test_a_bounded_passing_time_does_not_cover_the_others():
    early, late = PassingInterval(1, -math.inf, 0.4), PassingInterval(1, 0.4, math.inf)
    assert covered([Branch(0, (), (early,)), Branch(0, (), (late,))], [0])
    assert not covered([Branch(0, (), (early,)), Branch(0, (), (PassingInterval(0, 0.4, math.inf),))], [0])
    # A hoop and a share of T with the same number are two quantities.
    assert not covered([Branch(0, (TiltInterval(1, -math.inf, 0.4),)), Branch(0, (), (late,))], [0])
    assert not covered([Branch(None, (), (PassingInterval(0, -math.inf, math.inf),))], [0])


def test_parts_stay_unbounded_outwards():
    first, second = Branch(0).split_tilt(0.5, 1.0)
    assert first.held == (TiltInterval(0.5, -math.inf, 1.0),)
    assert second.held == (TiltInterval(0.5, 1.0, math.inf),)
    assert [part.held for part in second.split_tilt(0.5, 2.0)] == [
        (TiltInterval(0.5, 1.0, 2.0),),
        (TiltInterval(0.5, 2.0, math.inf),),
    ]
    early, late = first.split_passing(1, 0.3)
    assert early.held == late.held == first.held
    assert (early.passing, late.passing) == (
        (PassingInterval(1, -math.inf, 0.3),),
        (PassingInterval(1, 0.3, math.inf),),
    )
