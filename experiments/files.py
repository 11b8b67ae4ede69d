"""Results files: JSON with a schema number, written whole or not at all, and never lost if unreadable.

Commands write into USER_RESULTS, below the working directory, because an installed package must not write into the
folder it is installed in. PUBLISHED holds the results that ship with the package and that the README prints;
`flatquad publish`, run in a clone, copies them from REPOSITORY_RESULTS.
"""

from __future__ import annotations

import difflib
import json
import math
import os
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Any

from flatgym.files import free, write_text

Row = dict[str, Any]
"""A row of results, or a part of it, as JSON holds it."""
SCHEMA = 2
"""Version of the results files; files of another version are refused."""
ROOT = Path(__file__).resolve().parent.parent
"""The repository, or the folder in which the packages are installed."""
USER_RESULTS = Path("experiments/results")
"""Where the commands write, relative to the working directory."""
REPOSITORY_RESULTS = ROOT / "experiments" / "results"
PUBLISHED = REPOSITORY_RESULTS / "published"
"""The results that the README prints; they are part of the package."""


def cache_folder() -> Path:
    """Return the folder of computed flights, which are found again by the content of their scenario."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "flatquad"


def write_json(path: Path, data: Any) -> None:
    """Write plain data as JSON; numbers that are not finite become null, because JSON cannot hold them."""
    write_text(path, json.dumps(plain(data), indent=1, allow_nan=False) + "\n")


def read_json(path: Path) -> Row | None:
    """Return the content of a results file, or None if there is none that can be read.

    A file that cannot be read is moved aside under another name, which standard error states. The caller recomputes it.
    """
    if not path.exists():
        return None
    try:
        return load_json(path)
    except ValueError as error:
        print(f"{error}; moved aside to {move_aside(path).name}", file=sys.stderr)
        return None


def load_json(path: Path) -> Row:
    """Return the content of a results file.

    Raises:
        ValueError: if it is damaged or of another schema.
        OSError: if there is no such file.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error})") from None
    if not isinstance(data, dict):
        raise ValueError(f"{path} is damaged (not a JSON object)")
    if data.get("schema") != SCHEMA:
        command = str(data.get("command", ""))
        again = f", `{command}`" if command.startswith("flatquad ") else ""
        version = f"has schema {data.get('schema')!r}, this version reads {SCHEMA}"
        raise ValueError(f"{path} {version}: run the command again{again}")
    return data


def check_output(path: Path | str, endings: Collection[str] = ()) -> Path:
    """Return the path of a file that can be written; its folder is made. Commands call it before their work.

    Args:
        path: the file to write; an existing one may be replaced later, and is not touched here.
        endings: the known endings, such as ".csv"; any by default.

    Raises:
        ValueError: for another ending.
        OSError: if the path is a folder, or its folder cannot be made or written.
    """
    path = Path(path)
    if endings and path.suffix not in endings:
        near = difflib.get_close_matches(path.suffix, endings, n=1)
        hint = f"; did you mean {path.with_suffix(near[0]).name}?" if near else ""
        raise ValueError(f"unknown ending {path.suffix!r} of {path.name}; known: {', '.join(endings)}{hint}")
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; name a file in it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise type(error)(f"the folder of {path} cannot be made: {error}") from None
    if not os.access(path.parent, os.W_OK | os.X_OK) or (path.exists() and not os.access(path, os.W_OK)):
        raise PermissionError(f"{path} cannot be written: no permission; name a file elsewhere")
    return path


def move_aside(path: Path) -> Path:
    """Rename a file to a name that is free, and return its new path."""
    aside = free(path.with_name(f"{path.name}.set-aside"))
    path.replace(aside)
    return aside


def published(name: str) -> Any:
    """Return the content of a published results file; errors as in `load_json`."""
    return load_json(PUBLISHED / name)


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
