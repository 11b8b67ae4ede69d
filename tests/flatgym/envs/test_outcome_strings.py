"""Arrays of outcome strings: correct, and never changed after they were returned."""

import copy
import pickle

import numpy as np
import pytest

from flatgym.envs.outcome_strings import OutcomeStrings
from flatgym.task.scene import GOAL, OUTCOMES


def sample(generator, n):
    rows = np.flatnonzero(generator.random(n) < 0.2 * generator.integers(2))
    return rows, generator.integers(1, len(OUTCOMES), len(rows))


def expected(n, rows, outcomes):
    strings = ["flying"] * n
    for row, outcome in zip(rows, outcomes, strict=True):
        strings[row] = OUTCOMES[outcome]
    return strings


def test_arrays_and_views_that_a_caller_holds_never_change(generator):
    strings, held = OutcomeStrings(50), []
    for _ in range(100):
        rows, outcomes = sample(generator, 50)
        array, said = strings.of(rows, outcomes), expected(50, rows, outcomes)
        held.append((array, said) if generator.random() < 0.5 else (array[10:30], said[10:30]))
        del array  # a caller may hold a view only
        if generator.random() < 0.3:
            del held[int(generator.integers(len(held)))]
        for values, said in held:
            assert values.tolist() == said
    assert len(held) > 50


@pytest.mark.parametrize("duplicate", [lambda x: x, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_arrays_are_read_only_also_of_a_copy(duplicate):
    strings, none = duplicate(OutcomeStrings(10)), np.zeros(0, dtype=np.int64)
    for rows, outcomes in ((none, none), (np.array([3]), np.array([GOAL]))):
        with pytest.raises(ValueError, match="read-only"):
            strings.of(rows, outcomes)[0] = "mine"
    assert strings.of(none, none).tolist() == ["flying"] * 10
