"""Fingerprint of a policy: the SHA-256 of the file that defines it, and of the statistics of its observations.

    fingerprint("my_policy.zip");  fingerprint("my_module:policy");  fingerprint("agents/mine.py:Policy")

A zip holds the whole policy, except statistics of VecNormalize, which are a file of their own. Of an object, only the
file of its module is read: modules that it imports and files that it loads are not part of the fingerprint. Nothing is
loaded or run; only the packages around a dotted module name are imported.
"""

from __future__ import annotations

import hashlib
import importlib.util
import re
from pathlib import Path

LENGTH = 64
"""Hexadecimal digits of a fingerprint."""


def fingerprint(source: str | Path, statistics: Path | None = None) -> str:
    """Return the SHA-256 of a policy's file, in hexadecimal digits; with statistics, that of both files' SHA-256.

    Args:
        source: path of a file, or "module:object", or "file.py:object".
        statistics: file of the VecNormalize statistics with which it flies.

    Raises:
        ValueError: if there is no such file, or no such module with a source file.
    """
    path = Path(source)
    if not path.is_file():
        path = _source_file(str(source))
    digest = hashlib.sha256(path.read_bytes())
    if statistics is not None:
        digest = hashlib.sha256(digest.digest() + hashlib.sha256(statistics.read_bytes()).digest())
    return digest.hexdigest()


def is_fingerprint(text: object) -> bool:
    """Return whether a value has the form of a fingerprint."""
    return isinstance(text, str) and re.fullmatch(f"[0-9a-f]{{{LENGTH}}}", text) is not None


def _source_file(source: str) -> Path:
    """Return the source file of "module:object" or "file.py:object"."""
    place, colon, _ = source.rpartition(":")
    if not colon:
        raise ValueError(f"{source!r} is neither a file nor of the form module:object, as in my_module:policy")
    if place.endswith(".py"):
        if not Path(place).is_file():
            raise ValueError(f"there is no file {place!r} of the policy {source!r}")
        return Path(place)
    for name in (Path(*place.split(".")).with_suffix(".py"), Path(*place.split("."), "__init__.py")):
        if name.is_file():  # `load_policy` looks in the current folder first
            return name
    try:
        found = importlib.util.find_spec(place)
    except (ImportError, ValueError):
        found = None
    if found is None or found.origin is None or not Path(found.origin).is_file():
        raise ValueError(f"module {place!r} of the policy {source!r} has no source file")
    return Path(found.origin)
