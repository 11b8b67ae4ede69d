"""Publish the latest results: `make readme` copies them and rebuilds README's tables and pictures.

`experiments/results` holds your own runs and is not committed; `experiments/results/published` holds
the runs README speaks of. Between `<!-- NAME -->` and `<!-- /NAME -->` the README holds what `blocks`
returns; a test compares the two, so that a number typed by hand does not last.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from agents.policies.archive import PRETRAINED
from experiments.files import PUBLISHED, RESULTS, ROOT, published
from experiments.publishing import learner_figure, pictures
from experiments.publishing.demonstrations import demos
from experiments.publishing.environments import environments
from experiments.publishing.learners import learners, scores
from experiments.publishing.paper import paper
from experiments.publishing.policies import pretrained
from experiments.publishing.solvers import optima, roads
from flatgym.files import write_text

FILES = ("benchmark.json", "benchmark.csv", "paper.json", "solvers.json", "envs.json", "demos.json", "learners.json")


def blocks() -> dict[str, str]:
    """Return the generated parts of the README by name."""
    return {
        "flights": pictures.captions(published("benchmark.json")),
        "scores": scores(published("benchmark.json")),
        "paper": paper(published("paper.json")),
        "optima": optima(published("solvers.json")),
        "roads": roads(published("solvers.json")),
        "environments": environments(published("envs.json")),
        "learners": measured("learners.json", learners),
        "pretrained": pretrained(PRETRAINED),
        "demos": measured("demos.json", demos),
    }


def measured(name: str, told: Callable[[dict[str, Any]], str]) -> str:
    """Return what is told of a results file, or that there is none yet: those of hours' work come last."""
    return told(published(name)) if (PUBLISHED / name).exists() else "Not measured yet."


def filled(text: str) -> str:
    """Return the README's text with its blocks replaced."""
    for name, block in blocks().items():
        pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
        parts = pattern.split(text)
        if len(parts) != 4:
            raise ValueError(f"README.md must hold one block <!-- {name} --> ... <!-- /{name} -->")
        text = parts[0] + parts[1] + block + "\n" + parts[2] + parts[3]
    return text


def main() -> None:
    """Publish what new results there are, and bring README.md up to date."""
    for name in FILES:
        if (RESULTS / name).exists():
            write_text(PUBLISHED / name, (RESULTS / name).read_text(encoding="utf-8"))
    path = ROOT / "README.md"
    write_text(path, filled(path.read_text(encoding="utf-8")))
    pictures.draw(PUBLISHED, published("benchmark.json"), published("paper.json"))
    if (PUBLISHED / "learners.json").exists():
        learner_figure.draw(PUBLISHED, published("learners.json"))


if __name__ == "__main__":
    main()
