"""Tables of defaults hold every field with its value and its meaning, from either form of docstring."""

from dataclasses import dataclass, field, fields

import pytest

from agents.imitation import DaggerConfig
from agents.training.configs import PPOConfig
from experiments.publishing.defaults import attributes, defaults
from flatgym import Quadrotor, Scenario


@dataclass(frozen=True)
class Listed:
    """A class.

    Attributes:
        first, second: what both are [m/s^2],
            over two lines.
        third: a|b.

    Raises:
        ValueError: never.
    """

    first: float
    second: float = 0.5
    third: Quadrotor = field(default_factory=Quadrotor)


@dataclass(frozen=True)
class Below(Listed):
    """A class whose own field is described below it."""

    fourth: int = 5_000_000
    """The fourth.  Of
    two lines."""


def test_a_table_has_a_row_for_each_field():
    assert defaults(Below).splitlines() == [
        "| field | default | meaning |",
        "| --- | --- | --- |",
        "| `first` | required | what both are [m/s²], over two lines |",
        "| `second` | `0.5` | what both are [m/s²], over two lines |",
        r"| `third` | `Quadrotor()` | a\|b |",
        "| `fourth` | `5_000_000` | The fourth. Of two lines |",
    ]


@pytest.mark.parametrize("kind", [Quadrotor, Scenario, PPOConfig, DaggerConfig])
def test_every_field_of_a_published_table_has_a_meaning(kind):
    known = attributes(kind)
    assert all(known.get(one.name) for one in fields(kind))
