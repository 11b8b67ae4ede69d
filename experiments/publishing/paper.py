"""The paper's tables in Markdown, from `paper.json`."""

from __future__ import annotations

from typing import Any

from experiments.paper.tables import paper_tables
from experiments.publishing.markdown import markdown, paragraph

FIGURE = "![Printed and certified times against the proven bound](experiments/results/published/verdicts.svg)"


def paper(results: dict[str, Any]) -> str:
    """Return the tables of the paper's times, of the verdicts on them, and of the initialisation study."""
    parts = []
    for name, table in paper_tables(results).items():
        parts += [f"**{table.title}**", markdown(table.head, table.rows), paragraph(table.note)]
        parts += [FIGURE] if name == "verdicts" else []
    return "\n\n".join(parts)
