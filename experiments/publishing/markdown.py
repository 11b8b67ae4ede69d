"""TODO experiments/publishing/markdown.py."""

from __future__ import annotations


def markdown(head: list[str], rows: list[list[str]]) -> str:
    """Return a table in Markdown, all columns but the first aligned to the right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
