"""The look of the terminal: tables and JSON on standard output, progress and messages on standard error.

A table never breaks a word or a number from its unit. On a narrow terminal cells wrap between words, then optional
columns are left out. If that is not enough, each row becomes a block of lines.
"""

from __future__ import annotations

import json
import math
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from textwrap import wrap
from typing import Any, Literal

import pandas as pd
import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from experiments.files import plain
from experiments.formats import SHARES, share
from experiments.interrupts import NOTHING, Kept, keeping

GAP = 2
"""Spaces between two columns."""
NO_BREAK = "\N{NO-BREAK SPACE}"
COLORS: Literal["auto"] | None = None if os.environ.get("NO_COLOR") else "auto"
"""Colour system of the consoles; without one they print no escape codes for styles."""
screen, messages = Console(highlight=False, color_system=COLORS), Console(stderr=True, color_system=COLORS)


@contextmanager
def progress_bar(kept: Kept = NOTHING) -> Iterator[Progress]:
    """Show a progress bar on standard error if that is a terminal and NO_COLOR is not set.

    Standard output is for data only: what anything else prints meanwhile goes to standard error, as Ray's notes do.

    Args:
        kept: what Ctrl-C says about what is kept and how to go on.
    """
    bar = Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}", markup=False),
        console=messages,
        disable=not messages.is_terminal or COLORS is None,
    )
    with keeping(kept), redirect_stdout(sys.stderr), bar:
        yield bar


def command_line() -> str:
    """Return the command line as typed, for the record in results files."""
    return " ".join(["flatquad", *sys.argv[1:]])


def show(rows: pd.DataFrame, as_json: bool, title: str = "", columns: dict[str, str] | None = None) -> None:
    """Print rows as a JSON list of objects or as a table.

    Args:
        rows: the data.
        as_json: whether to print JSON; it holds all columns.
        title: of the table.
        columns: the columns of the table and their headings; by default all columns.
    """
    if as_json:
        typer.echo(json.dumps(plain(rows.to_dict("records")), indent=1))
        return
    if columns is not None:
        rows = rows[list(columns)].rename(columns=columns).round(4)
    table(title, list(rows.columns), [[cell(value) for value in row] for _, row in rows.iterrows()])


def table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], optional: Sequence[str] = ()) -> None:
    """Print a table of texts under a title; columns that mostly hold numbers are aligned to the right.

    Args:
        title: one line.
        head: the headings.
        rows: the cells.
        optional: headings of columns to leave out, in this order, until the table fits the terminal.
    """
    glued = [[glue(text) for text in row] for row in (head, *rows)]
    widths = column_widths(glued, screen.width)
    if widths is None and optional:
        kept = [i for i, heading in enumerate(head) if heading != optional[0]]
        fewer = [[row[i] for i in kept] for row in (head, *rows)]
        table(title, fewer[0], fewer[1:], optional[1:])
        return
    if title:
        screen.print(Text(title, style="italic"))
    if widths is None:
        blocks(head, rows)
        return
    wrapped = [["\n".join(lines_of(text, width)) for text, width in zip(row, widths, strict=True)] for row in glued]
    grid = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, GAP - 1, 0, 0))
    for heading, column in zip(wrapped[0], zip(*rows, strict=True), strict=True):
        justify = "right" if 2 * sum(map(numeric, column)) > len(column) else "left"
        grid.add_column(Text(heading.replace(NO_BREAK, " ")), justify=justify, no_wrap=True)  # type: ignore[arg-type]
    for row in wrapped[1:]:
        grid.add_row(*(Text(text.replace(NO_BREAK, " ")) for text in row))
    screen.print(grid)
    screen.print()


def blocks(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print each row as a block of lines, a line for each column."""
    for first, *others in rows:
        screen.print(Text(first, style="bold"))
        for heading, text in zip(head[1:], others, strict=True):
            screen.print(Text(f"  {heading}: {text}"))
    screen.print()


def paragraph(text: str) -> None:
    """Print a paragraph below a table."""
    screen.print(Text("\n".join(lines_of(glue(text), min(screen.width, 100))).replace(NO_BREAK, " ")))
    screen.print()


def lines_of(text: str, width: int) -> list[str]:
    """Return a text in lines of at most `width`, broken between words only."""
    return wrap(text, width, break_on_hyphens=False, break_long_words=False)


def glue(text: str) -> str:
    """Return a text whose spaces within brackets, points and numbers with a unit are not broken."""
    text = re.sub(r"(?<=\d) (?=(%|s|ms|k|M|kB|MB|m)(\b|\W|$))", NO_BREAK, text)
    return re.sub(r"\[[^\]]*\]|\([-\d.]+, [-\d.]+\)", lambda found: found[0].replace(" ", NO_BREAK), text)


def column_widths(rows: Sequence[Sequence[str]], width: int) -> list[int] | None:
    """Return widths of the columns at which no word breaks, or None if there are none within a width."""
    columns = list(zip(*rows, strict=True))
    widths = [max(map(len, column)) for column in columns]
    least = [max(len(word) for text in column for word in text.split(" ")) for column in columns]
    room = width - GAP * (len(columns) - 1)
    if sum(least) > room:
        return None
    while sum(widths) > room:
        widest = max((i for i in range(len(widths)) if widths[i] > least[i]), key=lambda i: widths[i] - least[i])
        widths[widest] -= 1
    return widths


def numeric(text: str) -> bool:
    """Return whether a cell holds a number, perhaps with unit and interval, or a dash for a missing one."""
    return text == "-" or bool(re.match(r"[+\-≥≤]? ?\d", text))


def show_record(row: dict[str, Any], as_json: bool, title: str) -> None:
    """Print one row as a JSON list of one object, or as a line for each field; shares are in per cent."""
    if as_json:
        show(pd.DataFrame([row], dtype=object), as_json)
        return
    indent = max(map(len, row)) + GAP
    screen.print(Text(title, style="italic"))
    for field, value in row.items():
        known = field in SHARES and isinstance(value, (int, float)) and math.isfinite(value)
        lines = lines_of(glue(share(field, value) if known else cell(value)), max(screen.width - indent, 20)) or [""]
        screen.print(Text(f"{field:<{indent}}" + f"\n{' ' * indent}".join(lines).replace(NO_BREAK, " ")))


def cell(value: Any) -> str:
    """Return a value as text; a dash for a missing one."""
    if value is None or (isinstance(value, float) and pd.isna(value)):
        return "-"
    if isinstance(value, bool) or not isinstance(value, float):
        return str(value)
    return f"{value:.6g}" if abs(value) >= 1e-3 else f"{value:.2g}"
