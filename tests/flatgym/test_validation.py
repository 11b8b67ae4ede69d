"""Names out of a list: an unknown one is refused with the list and the nearest name."""

import pytest

from flatgym.validation import choice


def test_a_known_name_is_returned():
    assert choice("method", "flat", ("shooting", "flat")) == "flat"


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("flt", "unknown method 'flt'; known: shooting, Flat; did you mean 'Flat'?"),
        ("FLAT", "unknown method 'FLAT'; known: shooting, Flat; did you mean 'Flat'?"),
        ("quantum", "unknown method 'quantum'; known: shooting, Flat"),
        (3, "unknown method 3; known: shooting, Flat"),
        (None, "unknown method None; known: shooting, Flat"),
    ],
)
def test_an_unknown_name_is_refused_with_the_list_and_the_nearest(value, words):
    with pytest.raises(ValueError, match="unknown method") as error:
        choice("method", value, ("shooting", "Flat"))
    assert str(error.value) == words


def test_an_empty_list_is_named():
    with pytest.raises(ValueError, match="unknown policy 'mine'; known: none"):
        choice("policy", "mine", ())
