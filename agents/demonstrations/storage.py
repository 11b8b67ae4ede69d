"""Datasets take their places whole: written beside Minari's folders, then renamed.

Minari writes a dataset where it will be read, and HDF5 crashes where the disk is full. So room is made sure of first,
the dataset is written in a folder of ours, and an older one of its name gives way only when it is done.
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

from flatgym.scenarios.catalogue import ProblemLike
from flatgym.scenarios.catalogue import problem as problem_named

RECORDING = "recording-"
"""How folders of datasets not yet whole are called."""
ABANDONED = 24 * 3600.0
"""Age at which a half-written dataset belongs to a process that was killed [s]."""


def dataset_id(problem: ProblemLike, name: str | None = None) -> str:
    """Return Minari's id of a dataset: the name given, of version 0 where it has none, or one after the problem.

    Raises:
        ValueError: for a name that Minari does not take.
    """
    if name is None:
        word = re.sub(r"[^\w-]+", "-", problem_named(problem).name)
        return f"flatquad/{word}/optimal-v0"
    whole = name if re.search(r"-v\d+$", name) else f"{name}-v0"
    try:
        parse_dataset_id(whole)
    except ValueError:
        raise ValueError(
            f"a dataset's name is made of letters, digits, '-' and '_', with '/' between namespaces, got {name!r}"
        ) from None
    return whole


def staging_folder() -> Path:
    """Return our folder beside Minari's datasets, which Minari does not look into."""
    return Path(get_dataset_path()) / ".flatquad"


@contextmanager
def atomic_dataset(identity: str, size: int) -> Iterator[Path]:
    """Give a folder to write a dataset in; it takes the place of the one of that name once all is written.

    Args:
        identity: Minari's id.
        size: room that the dataset takes at most [bytes].

    Raises:
        ValueError: where other datasets are below that name.
        OSError: naming the place, where it cannot be written.
    """
    place = Path(get_dataset_path(identity))
    if place.exists() and not (place / "data").exists():
        raise ValueError(f"{identity!r} is a namespace of other datasets; choose another name")
    try:
        with tempfile.TemporaryDirectory(prefix=RECORDING, dir=_clean_staging(staging_folder())) as temporary:
            _make_sure_of_room(Path(temporary, "room"), size)
            made = Path(temporary, "made")
            made.mkdir()
            yield made / "data"
            _move(made, place, Path(temporary, "before"))
        namespace = parse_dataset_id(identity)[0]
        if namespace is not None and namespace not in list_local_namespaces():
            create_namespace(namespace)
    except OSError as error:
        raise OSError(
            error.errno or errno.EIO,
            f"{error.strerror or error}; an older dataset of this name is as it was: make room and run again",
            str(place),
        ) from error


def _make_sure_of_room(path: Path, size: int) -> None:
    """Write a file of that size and remove it: HDF5 crashes on a full disk, Python says so."""
    with path.open("wb", buffering=0) as file:
        while size > 0:
            size -= file.write(bytes(min(size, 2**20)))
    path.unlink()


def _clean_staging(folder: Path) -> Path:
    """Make the folder, rid of what killed processes left there."""
    folder.mkdir(parents=True, exist_ok=True)
    for left in folder.glob(f"{RECORDING}*"):
        if time.time() - left.stat().st_mtime > ABANDONED:
            shutil.rmtree(left, ignore_errors=True)
    return folder


def _move(made: Path, place: Path, aside: Path) -> None:
    """Move a whole dataset to its place; an older one goes aside, and back should that fail.

    A process killed between the two leaves none there; it is made anew when the run is resumed.
    """
    place.parent.mkdir(parents=True, exist_ok=True)
    if place.exists():
        place.rename(aside)
    try:
        made.rename(place)
    except OSError:
        if aside.exists():
            aside.rename(place)
        raise
