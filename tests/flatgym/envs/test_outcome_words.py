"""Words of outcomes: what was handed out stays as it was, and what nobody holds is used again."""

import numpy as np
import pytest

from flatgym.envs.outcome_words import KEPT, OutcomeStrings
from flatgym.task.scene import GOAL, OUTCOMES


def drawn(generator, n):
    rows = np.flatnonzero(generator.random(n) < 0.2)
    return rows, generator.integers(1, len(OUTCOMES), len(rows))


def expected(n, rows, outcomes):
    words = ["flying"] * n
    for row, outcome in zip(rows, outcomes, strict=True):
        words[row] = OUTCOMES[outcome]
    return words


def test_arrays_say_what_they_said_however_many_are_held(generator):
    words, held = OutcomeStrings(50), []
    for _ in range(100):
        rows, outcomes = drawn(generator, 50)
        held.append((words.of(rows, outcomes), expected(50, rows, outcomes)))
        if generator.random() < 0.5:
            del held[int(generator.integers(len(held)))]
        for array, said in held:
            assert array.tolist() == said
    assert len(held) > KEPT
    assert len(words._lent) <= KEPT


def test_what_nobody_holds_is_used_again_and_what_a_view_holds_is_not():
    words, nobody = OutcomeStrings(10), np.zeros(0, dtype=np.int64)
    first = words.of(nobody, nobody)
    place = first.__array_interface__["data"][0]
    part = first[2:4]
    del first
    assert words.of(nobody, nobody).__array_interface__["data"][0] != place
    assert part.tolist() == ["flying"] * 2
    del part
    places = {words.of(np.array([3]), np.array([GOAL])).__array_interface__["data"][0] for _ in range(3)}
    assert place in places
    with pytest.raises(ValueError, match="read-only"):
        words.of(nobody, nobody)[0] = "mine"
