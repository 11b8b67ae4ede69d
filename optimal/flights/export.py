"""Flights on disk: CSV, JSON or NPZ, with quantity and unit in the column names.

    t_s, x_m, z_m, vx_mps, vz_mps, theta_rad, thrust_mps2, rate_radps               a sampled reference
    t_s, x_m, z_m, vx_mps, vz_mps, theta_rad, held_thrust_mps2, held_rate_radps     held controls

A row is an instant, with the state at it. In a sampled reference the control is that of this instant: it changes before
the next row, so a flight that holds it misses the goal. A held control is kept until the time of the next row, and
`Quadrotor.step` flies exactly from row to row; the last row repeats the last control. Numbers are written in full;
reading returns the same numbers to the bit. Files hold plain numbers and nothing executable.
"""

from __future__ import annotations

import csv
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from flatgym.files import write_whole
from flatgym.quadrotor import Array
from optimal.flights.trajectory import Flight, Samples, Trajectory

STATE_COLUMNS = ("t_s", "x_m", "z_m", "vx_mps", "vz_mps", "theta_rad")
COLUMNS = (*STATE_COLUMNS, "thrust_mps2", "rate_radps")
HELD_COLUMNS = (*STATE_COLUMNS, "held_thrust_mps2", "held_rate_radps")

Columns = dict[str, list[float]]


class Answer(Protocol):
    """The answer of `optimal.solve` or `optimal.fewest_steps`."""

    @property
    def trajectory(self) -> Flight | None:
        """The flight; None if there is none."""


def save(flight: Samples | Flight | Answer, path: str | Path) -> Path:
    """Write a flight to a .csv, .json or .npz file; an existing file is replaced only when the write succeeds.

    Args:
        flight: samples, as from `trajectory.sample(dt)`; or a flight with held controls, or an answer that has one,
            which is written exactly at its breakpoints.
        path: the file; its ending selects the format.

    Raises:
        ValueError: for an unknown ending, samples that are not finite, an answer without a flight, or a flight whose
            controls are not held.
    """
    path = Path(path)
    write = _format(path)[0]
    samples = flight if isinstance(flight, Samples) else _held(flight)
    table = np.column_stack([samples.time, samples.state, samples.control])
    if not np.isfinite(table).all():
        raise ValueError("samples must be finite numbers; this flight has NaN or infinity")
    columns = dict(zip(HELD_COLUMNS if samples.held else COLUMNS, table.T, strict=True))
    write_whole(path, lambda temporary: write(temporary, columns))
    return path


def _held(flight: Flight | Answer) -> Samples:
    """Return the held controls of a flight or of an answer's flight."""
    held = getattr(flight, "trajectory", flight)
    if type(held) is Trajectory:
        return held.held()
    if held is None:
        raise ValueError("there is no flight in this answer; see its status and reason")
    raise ValueError(
        f"the controls of a {type(held).__name__} are not held between breakpoints; write samples of it, "
        "`optimal.save(flight.sample(dt), path)`"
    )


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
        held = HELD_COLUMNS[-1] in columns
        table = np.array([columns[name] for name in (HELD_COLUMNS if held else COLUMNS)], dtype=np.float64)
    except (KeyError, TypeError, ValueError, csv.Error, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} does not hold the columns {', '.join(COLUMNS)}: {error}") from None
    if table.size == 0 or not np.isfinite(table).all():
        raise ValueError(f"{path} must hold finite numbers and at least one row")
    return Samples(table[0], table[1:6].T, table[6:8].T, held)


def _write_csv(path: Path, columns: dict[str, Array]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([repr(value) for value in row] for row in np.column_stack(list(columns.values())).tolist())


def _read_csv(path: Path) -> Columns:
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file, strict=True)
        rows = list(reader)
    return {name: [float(row[name]) for row in rows] for name in reader.fieldnames or ()}


def _write_json(path: Path, columns: dict[str, Array]) -> None:
    plain = {name: values.tolist() for name, values in columns.items()}
    path.write_text(json.dumps(plain, allow_nan=False) + "\n", encoding="utf-8")


def _read_json(path: Path) -> Columns:
    columns: Columns = json.loads(path.read_text(encoding="utf-8"))
    return columns


def _write_npz(path: Path, columns: dict[str, Array]) -> None:
    np.savez(path, **columns)  # type: ignore[arg-type]


def _read_npz(path: Path) -> Columns:
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name].tolist() for name in file.files}


FORMATS: dict[str, tuple[Callable[[Path, dict[str, Array]], None], Callable[[Path], Columns]]] = {
    ".csv": (_write_csv, _read_csv),
    ".json": (_write_json, _read_json),
    ".npz": (_write_npz, _read_npz),
}
"""File endings, each with its writer and its reader."""


def _format(path: Path) -> tuple[Callable[[Path, dict[str, Array]], None], Callable[[Path], Columns]]:
    try:
        return FORMATS[path.suffix]
    except KeyError:
        raise ValueError(f"unknown ending {path.suffix!r} of {path.name}; known: {', '.join(FORMATS)}") from None
