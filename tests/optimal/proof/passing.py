"""Passing times that are known to lie within windows, with any time between two hoops."""

from optimal.proof.programme.stations import Passing


def known(windows) -> Passing:
    """Return the knowledge that hoops are passed within windows [s]."""
    windows = tuple((float(low), float(high)) for low, high in windows)
    return Passing(windows, ((0.0, 99.0),) * max(len(windows) - 1, 0))
