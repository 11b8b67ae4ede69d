"""Markdown tables and paragraphs."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

WIDTH = 118
"""Longest line of a generated paragraph."""


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown; all columns but the first are aligned to the right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def paragraph(text: str) -> str:
    """Return a text broken into lines of at most WIDTH, never at a hyphen."""
    return fill(text, WIDTH, break_on_hyphens=False)
