"""Atomic datasets: written in a staging folder beside Minari's datasets, then renamed.

Minari writes a dataset in place, and HDF5 crashes on a full disk. The required space is therefore reserved first, the
dataset is written to a staging folder, and an older dataset of its name is replaced only once it is complete.
"""

from __future__ import annotations

import errno
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from minari.dataset.minari_dataset import parse_dataset_id
from minari.namespace import create_namespace, list_local_namespaces
from minari.storage import get_dataset_path

from flatgym.scenarios.catalogue import ProblemLike, label

STAGING_PREFIX = "recording-"
"""Name prefix of folders with incomplete datasets."""
ABANDONED_AFTER = 24 * 3600.0
"""Age at which an incomplete dataset is attributed to a killed process [s]."""


def dataset_id(problem: ProblemLike, name: str | None = None) -> str:
    """Return Minari's id of a dataset: the given name, with version 0 by default, or a name from the problem's label.

    Raises:
        ValueError: for a name that Minari does not accept.
    """
    if name is None:
        word = re.sub(r"[^\w-]+", "-", label(problem), flags=re.ASCII)
        return f"flatquad/{word}/best-known-v0"
    whole = name if re.search(r"-v\d+$", name) else f"{name}-v0"
    try:
        parse_dataset_id(whole)
    except ValueError:
        raise ValueError(
            f"a dataset's name consists of letters, digits, '-' and '_', with '/' between namespaces, got {name!r}"
        ) from None
    return whole


def dataset_path(identity: str) -> Path:
    """Return the folder of a dataset, whether it exists or not.

    Raises:
        ValueError: if the name is a namespace of other datasets.
    """
    place = Path(get_dataset_path(identity))
    if place.exists() and not (place / "data").exists():
        raise ValueError(f"{identity!r} is a namespace of other datasets; choose another name")
    return place


def staging_folder() -> Path:
    """Return the staging folder beside Minari's datasets, which Minari ignores."""
    return Path(get_dataset_path()) / ".flatquad"


@contextmanager
def atomic_dataset(identity: str, size: int) -> Iterator[Path]:
    """Yield a folder for a dataset; on exit it replaces the dataset of that name.

    Args:
        identity: Minari's id.
        size: upper bound of the dataset's size [bytes].

    Raises:
        ValueError: if the name is a namespace of other datasets.
        OSError: naming the folder, if it cannot be written.
    """
    place = dataset_path(identity)
    try:
        with tempfile.TemporaryDirectory(prefix=STAGING_PREFIX, dir=_clean_staging(staging_folder())) as temporary:
            _make_sure_of_room(Path(temporary, "room"), size)
            made = Path(temporary, "made")
            made.mkdir()
            yield made / "data"
            _replace(made, place, Path(temporary, "before"))
        namespace = parse_dataset_id(identity)[0]
        if namespace is not None and namespace not in list_local_namespaces():
            create_namespace(namespace)
    except OSError as error:
        raise OSError(
            error.errno or errno.EIO,
            f"{error.strerror or error}; an older dataset of this name is unchanged; free some space and run again",
            str(place),
        ) from error


def _make_sure_of_room(path: Path, size: int) -> None:
    """Write and remove a file of that size: on a full disk Python raises an error, whereas HDF5 crashes."""
    with path.open("wb", buffering=0) as file:
        while size > 0:
            size -= file.write(bytes(min(size, 2**20)))
    path.unlink()


def _clean_staging(folder: Path) -> Path:
    """Create the folder, and remove the leftovers of killed processes."""
    folder.mkdir(parents=True, exist_ok=True)
    for left in folder.glob(f"{STAGING_PREFIX}*"):
        if time.time() - left.stat().st_mtime > ABANDONED_AFTER:
            shutil.rmtree(left, ignore_errors=True)
    return folder


def _replace(made: Path, place: Path, aside: Path) -> None:
    """Move a complete dataset to its place; an older one is moved aside, and back if that fails.

    A process killed between the two moves leaves no dataset; the same command records it again.
    """
    place.parent.mkdir(parents=True, exist_ok=True)
    if place.exists():
        place.rename(aside)
    try:
        made.rename(place)
    except BaseException:
        if aside.exists() and not place.exists():
            aside.rename(place)
        raise
