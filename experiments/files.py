"""Results on disk: written whole or not at all."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from optimal.export import write_text

SCHEMA = 1
"""Version of the results files; a reader refuses another."""


def write_json(path: Path, data: Any) -> None:
    """Write plain data as JSON; numbers that are not finite become null, as JSON has no word for them."""
    write_text(path, json.dumps(plain(data), indent=1, allow_nan=False) + "\n")


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
