"""All rows of the paper's tables, each computed in a process of its own.

`compare` gives one case's flight times, `check_printed_time` the verdict on its printed time, `initialisation_study`
the cost of one method's solve from its default initial guess. Cold solve times include building the program, so no
row may find what another has built.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from typing import Any

import pandas as pd

from experiments.paper.comparison import COLUMNS, compare
from experiments.paper.initialisation import INITIALISATION_COLUMNS, METHODS, initialisation_study
from experiments.paper.printed import PRINTED, in_free_space
from experiments.paper.verdicts import VERDICT_COLUMNS, check_printed_time
from optimal.parallel import blocked_interrupts

PROCESSES = 2
TABLES: dict[str, tuple[Callable[..., dict[str, Any]], tuple[str, ...]]] = {
    "rows": (compare, COLUMNS),
    "verdicts": (check_printed_time, VERDICT_COLUMNS),
    "initialisation": (initialisation_study, INITIALISATION_COLUMNS),
}
"""The tables by their keys in `paper.json`: the function that computes a row, and the columns."""


def row_tasks() -> list[tuple[str, tuple[str, ...]]]:
    """Return one task a row: the table, and the case or the case and method."""
    cases = [(table, (name,)) for table in ("rows", "verdicts") for name in PRINTED]
    pairs = [(name, method) for name in PRINTED for method in METHODS if method != "pontryagin" or in_free_space(name)]
    return [*cases, *(("initialisation", pair) for pair in pairs)]


def compute_row(task: tuple[str, tuple[str, ...]]) -> dict[str, Any]:
    """Return the row of one of the `row_tasks`."""
    table, arguments = task
    return TABLES[table][0](*arguments)


def compute_tables(progress: Callable[[], Any] = lambda: None) -> dict[str, pd.DataFrame]:
    """Return all TABLES by key; `progress` is called after each row."""
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in TABLES}
    tasks = row_tasks()
    with blocked_interrupts():
        workers = multiprocessing.get_context("spawn").Pool(PROCESSES, maxtasksperchild=1)
    with workers as pool:
        for (table, _), row in zip(tasks, pool.imap(compute_row, tasks), strict=True):
            rows[table].append(row)
            progress()
    return {name: pd.DataFrame(rows[name], columns=list(columns)) for name, (_, columns) in TABLES.items()}
