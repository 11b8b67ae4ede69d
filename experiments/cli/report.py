"""TODO experiments/cli/report.py."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.options import AsJson
from experiments.files import read_json
from experiments.terminal import RESULTS, messages, progress_bar

EXAMPLES = "Example: flatquad report --out page.html"


def report(
    results: Annotated[
        Path | None, typer.Option(help="A benchmark's JSON; by default your newest, else the published ones.")
    ] = None,
    out: Annotated[Path, typer.Option(help="The page to write.")] = RESULTS / "report.html",
    as_json: AsJson = False,
) -> None:
    """Write one page of all results: leaderboard, gaps, learning curves, the paper's figures, and a ghost race."""
    from experiments.benchmark.results import merged
    from experiments.files import published
    from experiments.report.page import write

    if results is not None and not results.exists():
        raise ValueError(f"there is no {results}; `flatquad benchmark` writes one")
    own = [results] if results else sorted(RESULTS.glob("benchmark*.json"), key=lambda path: -path.stat().st_mtime)
    found = [data for path in own[:1] if (data := read_json(path)) is not None]
    if results is not None and not found:
        raise ValueError(f"{results} holds no results that can be read")
    with progress_bar() as bar:
        bar.add_task("report", total=None, note="")
        shown = merged(*found, *(() if results else (published("benchmark.json"), published("learners.json"))))
        page = write(out, shown, published("paper.json"))
    if as_json:
        typer.echo(json.dumps({"report": str(page.resolve()), "bytes": page.stat().st_size}))
    else:
        messages.print(f"report: {page.resolve()}", soft_wrap=True)
