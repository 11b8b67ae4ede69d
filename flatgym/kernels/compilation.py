"""Compilation by numba, with its results stored on disk where that is possible.

Numba itself raises an error where it finds no folder to write to, and where a stored file is damaged. Here the function
is compiled in memory instead, and one line on standard error tells why.
"""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Callable
from functools import cache
from glob import escape
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile


class KeyedFiles(IndexDataCacheFile):
    """The stored code of one function: a file for each signature, named after it.

    Numba numbers the files and keeps an index, which two processes may read before either writes it: then one file has
    two signatures, and the code of one of them is called with arguments of the other.
    """

    def save(self, key: Any, data: Any) -> None:
        """Store the code of a key (signature, processor, digests of the function's own code)."""
        self._save_data(self._file(key), (self._source_stamp, key, data))  # type: ignore[no-untyped-call]

    def load(self, key: Any) -> Any:
        """Return the code of a key; None if it is not stored, or was compiled from other sources."""
        try:
            stamp, stored, data = self._load_data(self._file(key))  # type: ignore[no-untyped-call]
        except OSError:
            return None
        return data if (stamp, stored) == (self._source_stamp, key) else None

    def flush(self) -> None:
        """Remove the stored code of all signatures."""
        for path in Path(self._cache_path).glob(f"{escape(Path(self._index_name).stem)}.*.nbc"):
            path.unlink(missing_ok=True)

    def _file(self, key: Any) -> str:
        signature, processor, _ = key
        digest = hashlib.sha256(repr((self._version, signature, processor)).encode()).hexdigest()
        return f"{Path(self._index_name).stem}.{digest[:16]}.nbc"


@cache
def sources(folder: Path) -> str:
    """Return a digest of the Python files of a folder, because compiled code contains that of functions it calls."""
    digest = hashlib.sha256()
    for file in sorted(folder.glob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()


class TolerantCache(FunctionCache):
    """Numba's cache of one function, which replaces damaged files and goes without those it cannot write."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        stamp = sources(Path(inspect.getfile(function)).parent)
        self._cache_file = KeyedFiles(self.cache_path, self._impl.filename_base, stamp)  # type: ignore[no-untyped-call]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function of a signature; None if it is not stored, or not readable."""
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception as error:  # whatever unpickling a damaged file may raise
            tell(f"the compiled code in {self.cache_path} is damaged ({error!r}), and is compiled again")
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the compiled function of a signature, if that is possible."""
        try:
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except Exception as error:
            tell(not_stored(error))


def cached(**options: Any) -> Callable[[Any], Any]:
    """Return `numba.njit` with these options and a TolerantCache; with NUMBA_DISABLE_JIT it changes nothing."""

    def decorate(function: Any) -> Any:
        dispatcher = numba.njit(**options)(function)
        if dispatcher is not function:
            try:
                dispatcher._cache = TolerantCache(function)
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
