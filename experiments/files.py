"""Results on disk: written whole or not at all, and never lost because they cannot be read."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

from flatgym.files import free, write_text

Row = dict[str, Any]
"""A row of results, or a part of them, as JSON holds it."""
SCHEMA = 1
"""Version of the results files; a reader refuses another."""


def write_json(path: Path, data: Any) -> None:
    """Write plain data as JSON; numbers that are not finite become null, as JSON has no word for them."""
    write_text(path, json.dumps(plain(data), indent=1, allow_nan=False) + "\n")


def read_json(path: Path) -> dict[str, Any] | None:
    """Return what a results file holds; None where there is none, and where it is damaged or of another version.

    Such a file is set aside under another name, and standard error says which.
    """
    if not path.exists():
        return None
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(data, dict) and data.get("schema") == SCHEMA:
            return data
        reason = (
            f"has schema {data.get('schema')!r}, wanted {SCHEMA}" if isinstance(data, dict) else "is no JSON object"
        )
    except (ValueError, OSError) as error:
        reason = f"is damaged ({error})"
    print(f"{path} {reason}; set aside as {set_aside(path).name}", file=sys.stderr)
    return None


def set_aside(path: Path) -> Path:
    """Give a file another name, which is free, and return it."""
    aside = free(path.with_name(f"{path.name}.set-aside"))
    path.replace(aside)
    return aside


def plain(data: Any) -> Any:
    """Return data as JSON can hold it: dictionaries, lists, strings, finite numbers, None."""
    if isinstance(data, dict):
        return {str(key): plain(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [plain(value) for value in data]
    if hasattr(data, "tolist"):
        return plain(data.tolist())
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data


ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "experiments" / "results"
PUBLISHED = RESULTS / "published"


def published(name: str) -> Any:
    """Return a published results file; a ValueError names one of another version."""
    path = PUBLISHED / name
    results = json.loads(path.read_text(encoding="utf-8"))
    if results.get("schema") != SCHEMA:
        raise ValueError(f"{path} has schema {results.get('schema')!r}, this version reads {SCHEMA}: run it again")
    return results
