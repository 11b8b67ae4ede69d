"""TODO experiments/cli/paper.py."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.options import AsJson
from experiments.files import plain, write_json
from experiments.terminal import RESULTS, command_line, messages, progress_bar, screen, show

EXAMPLES = "Example: flatquad paper --json"


def paper(
    out: Annotated[Path, typer.Option(help="File to write the rows to; the figures go beside it.")] = RESULTS
    / "paper.json",
    as_json: AsJson = False,
) -> None:
    """Compare the paper's printed times with what can be flown, judge which are impossible, and draw its figures."""
    from experiments.paper import figures, initialisation, verdicts
    from experiments.paper.tables import questions
    from experiments.paper.tables import tables as paper_tables
    from experiments.provenance import provenance

    with progress_bar() as bar:
        work = bar.add_task("the paper's cases", total=len(questions()), note="")
        tables = paper_tables(progress=lambda: bar.advance(work))
        record = plain({name: table.to_dict("records") for name, table in tables.items()})
        write_json(out, provenance(command_line()) | record)
        pages = figures.pages(record["judged"])
        work = bar.add_task("the paper's figures", total=len(pages), note="")
        figures.write(pages, out.parent, progress=lambda: bar.advance(work))
    messages.print(f"results and figures: {out.parent.resolve()}")
    if as_json:
        typer.echo(json.dumps(record, indent=1))
        return
    titles = {
        "scenario": "case",
        "printed_s": "printed",
        "nodes_only_s": "nodes only",
        "nodes_only_violation": "excess",
        "flat_certified_s": "flat",
        "shooting_s": "T*",
        "pontryagin_s": "Pontryagin",
        "reference_8_s": "[8]",
    }
    show(tables["rows"], as_json, "The paper's flights: printed, rebuilt, flown [s]", titles)
    screen.print(
        "nodes only: the published transcription, limits at grid nodes only; its excess is the largest violation "
        "between nodes, relative to the limit. flat, T*: the paper's method and shooting, within all limits at all "
        "times. Pontryagin: the method of [8], for flights in free space.\n",
        markup=False,
    )
    titles = {
        "road": "road",
        "cases": "cases",
        "iterations": "iterations",
        "cold_s": "cold",
        "warm_s": "warm",
        "starts": "starts",
        "converged": "converged",
        "succeeded": "found",
    }
    show(
        initialisation.by_road(tables["ease"]),
        as_json,
        "How easily: one solve from a plain start, and such starts on several grids",
        titles,
    )
    screen.print(
        "Medians over the cases [s]; cold: with the program yet to be built; warm: again. found: starts whose flight "
        f"keeps all limits at all times and is within {initialisation.SUCCESS:.1%} of the road's best.\n",
        markup=False,
    )
    show(verdicts.verdicts(tables["judged"]), as_json, "The paper judged: which printed times are impossible [s]")
    screen.print(
        "No flight within the paper's limits is faster than the proven bound; one takes the time flown, the gap above "
        "it. A printed time is impossible if it lies below the bound even with half a unit of its last digit added. "
        f"{verdicts.judgement(tables['judged'])}",
        markup=False,
    )
