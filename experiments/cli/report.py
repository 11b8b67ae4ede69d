"""`flatquad report`: the HTML page of all results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.options import AsJson
from experiments.files import USER_RESULTS, Row, check_output, load_json, published
from experiments.terminal import messages, progress_bar

EXAMPLES = "Example: flatquad report --out page.html"


def report(
    results: Annotated[
        Path | None,
        typer.Option(help="Results of a benchmark, a JSON file.", show_default="your newest, else the published ones"),
    ] = None,
    out: Annotated[Path, typer.Option(help="The page to write.")] = USER_RESULTS / "report.html",
    as_json: AsJson = False,
) -> None:
    """Write one page with all results: leaderboard, gaps, learning curves, the paper's figures, and a race."""
    from experiments.benchmark.results import merge
    from experiments.corridor_figure import SECTION
    from experiments.report.page import write

    check_output(out, (".html",))
    if results is not None and not results.exists():
        raise ValueError(f"there is no {results}; `flatquad benchmark` writes one")
    if results is not None:
        shown = load_json(results)
    else:
        shown = merge(*newest_results(), published("benchmark.json"), published("learners.json"))
    with progress_bar() as bar:
        bar.add_task("report", total=None, note="")
        sections = published("solvers.json")["sections"]
        corridors = sections[SECTION]["rows"] if SECTION in sections else ()
        page = write(out, shown, published("paper.json"), corridors=corridors)
    if as_json:
        typer.echo(json.dumps({"report": str(page.resolve()), "bytes": page.stat().st_size}))
    else:
        messages.print(f"report: {page.resolve()}", soft_wrap=True)


def newest_results() -> list[Row]:
    """Return the newest results of a benchmark in USER_RESULTS, in a list; an empty one if none can be read."""
    paths = sorted(USER_RESULTS.glob("benchmark*.json"), key=lambda path: path.stat().st_mtime)
    try:
        return [load_json(path) for path in paths[-1:]]
    except ValueError as error:
        messages.print(f"not in the report: {error}", markup=False, soft_wrap=True)
        return []
