"""The tables of the paper, from `paper.json`, and of the demonstrations, from `demos.json`."""

from __future__ import annotations

from typing import Any

from experiments.files import Row
from experiments.formats import format_percent
from experiments.paper.tables import paper_tables
from experiments.provenance import provenance_sentence
from experiments.publishing.markdown import markdown, paragraph

FIGURE = "![Printed and certified times against the proven bound](experiments/results/published/verdicts.svg)"
HEAD = ["section", "flights", "flights/s", "K* proven", "mean steps", "replayed to goal", "kB per flight"]


def demos(results: Row) -> str:
    """Return how fast demonstrations are recorded, and how many replay to the goal in as many steps."""
    sections = results["sections"]
    rows = [
        [
            f"{name}, `{row['what']}`" if name != row["what"] else f"`{name}`",
            f"{row['flights']:,}",
            f"{row['per_second']:.1f}",
            format_percent(row["proven"]),
            f"{row['mean_steps']:.1f}",
            format_percent(row["replayed_to_goal"]),
            f"{row['bytes_per_flight'] / 1e3:.1f}",
        ]
        for name, section in sections.items()
        for row in section["rows"]
    ]
    processes = max(row["processes"] for section in sections.values() for row in section["rows"])
    command, dates = "flatquad measure demonstrations", [section["date"] for section in sections.values()]
    text = (
        f"{provenance_sentence(results, command=command, dates=dates)} With {processes} processes; the time includes "
        "everything up to the dataset on disk. K* is proven only if a time budget for proofs is given."
    )
    return markdown(HEAD, rows) + "\n\n" + paragraph(text)


def paper(results: dict[str, Any]) -> str:
    """Return the tables of the paper's times, of the verdicts on them, and of the initialisation study."""
    parts = []
    for name, table in paper_tables(results).items():
        parts += [f"**{table.title}**", markdown(table.head, table.rows), paragraph(table.note)]
        parts += [FIGURE] if name == "verdicts" else []
    return "\n\n".join(parts)
