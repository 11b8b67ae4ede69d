"""Compilation by numba, with its results stored on disk where that is possible.

Numba itself raises an error where it finds no folder to write to, and where a stored file is damaged. Here the function
is compiled in memory instead, and one line on standard error tells why.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numba
from numba.core.caching import FunctionCache


class TolerantCache(FunctionCache):
    """Numba's cache of one function, which replaces damaged files and goes without those it cannot write."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function of a signature; None if it is not stored, or not readable."""
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception as error:  # whatever unpickling a damaged file may raise
            tell(f"the compiled code in {self.cache_path} is damaged ({error!r}), and is compiled again")
            self._attempt(self.flush)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the compiled function of a signature, if that is possible."""
        save = super().save_overload
        self._attempt(lambda: save(sig, data))  # type: ignore[no-untyped-call]

    def _attempt(self, write: Callable[[], object]) -> None:
        try:
            write()
        except Exception as error:  # also unpickling, because a damaged index is read before it is written
            tell(not_stored(error))


def cached(**options: Any) -> Callable[[Any], Any]:
    """Return `numba.njit` with these options and a TolerantCache; with NUMBA_DISABLE_JIT it changes nothing."""

    def decorate(function: Any) -> Any:
        dispatcher = numba.njit(**options)(function)
        if dispatcher is not function:
            try:
                dispatcher._cache = TolerantCache(function)  # type: ignore[no-untyped-call]
            except RuntimeError as error:
                tell(not_stored(error))
        return dispatcher

    return decorate


def not_stored(error: Exception) -> str:
    """Return the notice for compiled code that cannot be written."""
    return (
        f"compiled code cannot be stored, so each process compiles again ({error}); the variable NUMBA_CACHE_DIR "
        "names a folder to store it in"
    )


_told: list[str] = []
"""Notices of this process; only the first is printed, because all functions share the folder."""


def tell(text: str) -> None:
    """Print the first notice to standard error."""
    if not _told:
        print(f"flatgym: {text}", file=sys.stderr, flush=True)
    _told.append(text)
