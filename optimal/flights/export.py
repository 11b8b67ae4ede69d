"""Flights on disk: CSV, JSON or NPZ, with quantity and unit in the column names.

    t_s, x_m, z_m, vx_mps, vz_mps, theta_rad, thrust_mps2, rate_radps

A row is an instant: the state at it, and the control held after it. The last row repeats the last control. Numbers are
written in full; reading returns the same numbers to the bit. Files hold plain numbers and nothing executable.
"""

from __future__ import annotations

import csv
import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from flatgym.files import write_whole
from flatgym.quadrotor import Array
from optimal.flights.trajectory import Samples

COLUMNS = ("t_s", "x_m", "z_m", "vx_mps", "vz_mps", "theta_rad", "thrust_mps2", "rate_radps")


def save(samples: Samples, path: str | Path) -> Path:
    """Write samples to a .csv, .json or .npz file; an existing file is replaced only when the write succeeds.

    Args:
        samples: times (n,), states (n, 5), controls (n, 2), as from `trajectory.sample(dt)`.
        path: the file; its ending selects the format.

    Raises:
        ValueError: for an unknown ending, or samples that are not finite.
    """
    path = Path(path)
    write = _format(path)[0]
    table = np.column_stack([samples.time, samples.state, samples.control])
    if not np.isfinite(table).all():
        raise ValueError("samples must be finite numbers; this flight has NaN or infinity")
    write_whole(path, lambda temporary: write(temporary, table))
    return path


def load(path: str | Path) -> Samples:
    """Read a file that `save` wrote.

    Raises:
        ValueError: for an unknown ending, or a file that does not hold these columns; names the file.
        FileNotFoundError: if there is no such file.
    """
    path = Path(path)
    read = _format(path)[1]
    try:
        columns = read(path)
        table = np.array([columns[name] for name in COLUMNS], dtype=np.float64)
    except (KeyError, TypeError, ValueError, csv.Error, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} does not hold the columns {', '.join(COLUMNS)}: {error}") from None
    if table.size == 0 or not np.isfinite(table).all():
        raise ValueError(f"{path} must hold finite numbers and at least one row")
    return Samples(table[0], table[1:6].T, table[6:8].T)


def _write_csv(path: Path, table: Array) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows([repr(value) for value in row] for row in table.tolist())


def _read_csv(path: Path) -> dict[str, list[float]]:
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file, strict=True))
    return {name: [float(row[name]) for row in rows] for name in COLUMNS}


def _write_json(path: Path, table: Array) -> None:
    columns = dict(zip(COLUMNS, table.T.tolist(), strict=True))
    path.write_text(json.dumps(columns, allow_nan=False) + "\n", encoding="utf-8")


def _read_json(path: Path) -> dict[str, list[float]]:
    columns: dict[str, list[float]] = json.loads(path.read_text(encoding="utf-8"))
    return columns


def _write_npz(path: Path, table: Array) -> None:
    np.savez(path, **dict(zip(COLUMNS, table.T, strict=True)))


def _read_npz(path: Path) -> dict[str, list[float]]:
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name].tolist() for name in COLUMNS}


Columns = dict[str, list[float]]
FORMATS: dict[str, tuple[Callable[[Path, Array], None], Callable[[Path], Columns]]] = {
    ".csv": (_write_csv, _read_csv),
    ".json": (_write_json, _read_json),
    ".npz": (_write_npz, _read_npz),
}
"""File endings, each with its writer and its reader."""


def _format(path: Path) -> tuple[Callable[[Path, Array], None], Callable[[Path], Columns]]:
    try:
        return FORMATS[path.suffix]
    except KeyError:
        raise ValueError(f"unknown ending {path.suffix!r} of {path.name}; known: {', '.join(FORMATS)}") from None
