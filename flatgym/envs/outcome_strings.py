"""Outcomes of a batch as strings, at the cost of one array copy a step.

Almost all entries are "flying". An array without other entries is shared by all callers. An array with other entries is
a fresh copy of it. All arrays are read-only, so a stored `info` never changes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatgym.task.scene import FLYING, OUTCOMES

STRINGS = np.array(OUTCOMES, dtype=object)


class OutcomeStrings:
    """Arrays of n outcomes as strings."""

    def __init__(self, n: int) -> None:
        self._flying = np.full(n, OUTCOMES[FLYING], dtype=object)
        self._flying.flags.writeable = False

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by construction: NumPy's own copies of a read-only array are writable."""
        return type(self), (len(self._flying),)

    def of(self, rows: NDArray[Any], outcomes: NDArray[Any]) -> NDArray[Any]:
        """Return an array of strings, shape (n,), dtype object, read-only.

        Args:
            rows: indices of the entries that differ from "flying", shape (m,).
            outcomes: their outcomes, indices into OUTCOMES, shape (m,).
        """
        if not len(rows):
            return self._flying
        strings = self._flying.copy()
        strings[rows] = STRINGS[outcomes.astype(np.intp)]
        strings.flags.writeable = False
        return strings
