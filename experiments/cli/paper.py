"""`flatquad paper`: the paper's tables and figures, recomputed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.options import AsJson
from experiments.files import USER_RESULTS, check_output, plain, write_json
from experiments.terminal import command_line, messages, paragraph, progress_bar, table

EXAMPLES = "Example: flatquad paper --json"


def paper(
    out: Annotated[Path, typer.Option(help="File to write the rows to; the figures go beside it.")] = USER_RESULTS
    / "paper.json",
    as_json: AsJson = False,
) -> None:
    """Recompute the paper's flight times, verify which printed times are impossible, and draw its figures."""
    from experiments.paper import figures, runs
    from experiments.paper.tables import paper_tables
    from experiments.provenance import provenance

    check_output(out, (".json",))
    with progress_bar() as bar:
        work = bar.add_task("rows of the paper's tables", total=len(runs.row_tasks()), note="")
        computed = runs.compute_tables(progress=lambda: bar.advance(work))
        record = plain({name: rows.to_dict("records") for name, rows in computed.items()})
        write_json(out, provenance(command_line()) | record)
        pages = figures.pages(record["verdicts"])
        work = bar.add_task("the paper's figures", total=len(pages), note="")
        figures.write_pages(pages, out.parent, progress=lambda: bar.advance(work))
    messages.print(f"results and figures: {out.parent.resolve()}", soft_wrap=True)
    if as_json:
        typer.echo(json.dumps(record, indent=1))
        return
    for text in paper_tables(record).values():
        table(text.title, text.head, text.rows, text.optional)
        paragraph(text.note)
