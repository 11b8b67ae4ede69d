"""TODO experiments/publishing/policies.py."""

from __future__ import annotations

import json
from pathlib import Path

from experiments.benchmark.formats import amount, rounded
from experiments.files import Row
from experiments.publishing.markdown import markdown


def pretrained(folder: Path) -> str:
    """Return the table of the policies in a folder, from the cards beside them."""
    cards = [(path.stem, json.loads(path.read_text(encoding="utf-8"))) for path in sorted(folder.glob("*.json"))]
    head = ["policy", "made by", "success", "steps", "K*", "gap", "steps flown", "training [s]", "size [kB]"]
    rows = [[f"`{name}`", *carded(card), kilobytes(folder / f"{name}.zip")] for name, card in cards]
    commands = [f"- `{name}`: `{card['command']}`" for name, card in cards]
    return "\n\n".join([markdown(head, rows), "The commands that made them:", "\n".join(commands)])


def carded(card: Row) -> list[str]:
    """Return what the score in a card says."""
    score = card["score"]
    return [
        score["algorithm"],
        rounded(score["success_rate"]),
        "-" if score["steps"] is None else f"{score['steps']:.4g}",
        f"{score['k_star']:.4g}",
        "-" if score["gap"] is None else f"{100 * score['gap']:+.1f} %",
        amount(score["env_steps"] or 0),
        f"{score['wall_time_s']:.0f}",
    ]


def kilobytes(path: Path) -> str:
    """Return the size of a file in units of 1,000 bytes."""
    return f"{path.stat().st_size / 1e3:.0f}"
