"""What the commands share: tables and JSON on standard output, progress and messages on standard error."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from experiments.files import plain

RESULTS = Path("experiments/results")
"""Where results go unless another folder is named."""
screen, messages = Console(), Console(stderr=True)


def progress_bar() -> Progress:
    """Return a progress bar on standard error, so that standard output stays clean for data."""
    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}"),
        console=messages,
    )


def command_line() -> str:
    """Return what the user typed, for the record in results files."""
    return " ".join(["flatquad", *sys.argv[1:]])


def show(rows: pd.DataFrame, as_json: bool, title: str = "", columns: dict[str, str] | None = None) -> None:
    """Print rows as a JSON list of objects, or as a table: all columns, or those in `columns` under shorter names."""
    if as_json:
        typer.echo(json.dumps(plain(rows.to_dict("records")), indent=1))
        return
    if columns is not None:
        rows = rows[list(columns)].rename(columns=columns).round(4)
    table = Table(title=escape(title), header_style="bold", title_justify="left")
    for i, column in enumerate(rows.columns):
        numeric = pd.api.types.is_numeric_dtype(rows[column])
        table.add_column(escape(column), justify="right" if numeric else "left", no_wrap=i == 0, overflow="fold")
    for _, row in rows.iterrows():
        table.add_row(*(escape(cell(value)) for value in row))
    screen.print(table)


def upright(row: dict[str, Any]) -> pd.DataFrame:
    """Return one row as a table of two columns, which fits a terminal."""
    return pd.DataFrame({"field": list(row), "value": [cell(value) for value in row.values()]})


def cell(value: Any) -> str:
    """Return a value as it stands in a table."""
    if value is None or (isinstance(value, float) and pd.isna(value)):
        return "-"
    if isinstance(value, bool) or not isinstance(value, float):
        return str(value)
    return f"{value:.6g}" if abs(value) >= 1e-3 else f"{value:.2g}"
