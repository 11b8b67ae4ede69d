"""The outcomes of a batch as words, without writing thousands of them anew in each step.

Nearly all say "flying", so an array is used again, with only the few words that differ put right, as soon as nobody
holds it any more. What is handed out is read-only, so that it still says what it did.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatgym.task.scene import FLYING, OUTCOMES

WORDS = np.array(OUTCOMES, dtype=object)
KEPT = 4
"""Most arrays kept for later."""
OURS = 3
"""References to an array that only we hold: of its entry in the list, of the local name, of the question itself."""


class OutcomeStrings:
    """Arrays of n outcomes as words."""

    def __init__(self, n: int) -> None:
        self._flying = np.full(n, OUTCOMES[FLYING], dtype=object)
        self._lent: list[tuple[NDArray[Any], NDArray[Any]]] = []

    def of(self, rows: NDArray[Any], outcomes: NDArray[Any]) -> NDArray[Any]:
        """Return an array, shape (n,), of "flying" but for the outcomes, indices into OUTCOMES, at `rows`."""
        words = self._take_back()
        words[rows] = WORDS[outcomes.astype(np.intp)]
        self._lent.append((words, rows))
        shown = words.view()
        shown.flags.writeable = False
        return shown

    def _take_back(self) -> NDArray[Any]:
        for i, (words, changed) in enumerate(self._lent):
            if sys.getrefcount(words) == OURS:
                del self._lent[i]
                words[changed] = OUTCOMES[FLYING]
                return words
        del self._lent[: len(self._lent) + 1 - KEPT]
        return self._flying.copy()
