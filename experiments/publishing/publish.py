"""Publish the latest results: `flatquad publish` copies them and rebuilds the tables and pictures of README and docs.

`experiments/results` holds your own runs and is not committed. `experiments/results/published` is committed and holds
the runs that README and docs report. Between `<!-- NAME -->` and `<!-- /NAME -->` a page holds what `BLOCKS[NAME]`
returns. A test compares the two, which finds numbers typed by hand.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from agents.imitation import CloneConfig, DaggerConfig
from agents.policies.archive import PRETRAINED
from agents.training.configs import PPOConfig
from experiments import corridor_figure
from experiments.files import PUBLISHED, REPOSITORY_RESULTS, ROOT, published
from experiments.publishing import chain
from experiments.publishing.defaults import defaults
from experiments.publishing.environments import environments
from experiments.publishing.figures import learners as learner_figure
from experiments.publishing.figures import pictures
from experiments.publishing.figures import study as study_figure
from experiments.publishing.learners import learners, scores
from experiments.publishing.policies import pretrained
from experiments.publishing.scenarios import sheet, table, tracks
from experiments.publishing.solvers import corridors, methods, optima
from experiments.publishing.study import full, trainings
from experiments.publishing.tables import demos, paper
from experiments.scoring import records
from flatgym.files import write_text
from flatgym.quadrotor import Quadrotor
from flatgym.scenarios.distributions import Distribution
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.scenario import Hoop, Scenario, Tolerance

FILES = (
    "benchmark.json",
    "benchmark.csv",
    "benchmark-full.json",
    "paper.json",
    "solvers.json",
    "envs.json",
    "demos.json",
    "learners.json",
    "trainings.json",
)
BLOCK = re.compile(r"(<!-- ([\w-]+) -->\n)(.*?)(<!-- /\2 -->)", re.DOTALL)
MARKER = re.compile(r"<!-- /?[\w-]+ -->")
BLOCKS: dict[str, Callable[[], str]] = {
    "flight": lambda: pictures.caption(published("benchmark.json")),
    "flights": lambda: pictures.captions(published("benchmark.json")),
    "scenarios": table,
    "scores": lambda: scores(published("benchmark.json")),
    "paper": lambda: paper(published("paper.json")),
    "optima": lambda: optima(published("solvers.json")),
    "methods": lambda: methods(published("solvers.json")),
    "corridors": lambda: corridors(published("solvers.json")),
    "chain-convergence": lambda: chain.convergence(published("solvers.json")),
    "chain-hoops": lambda: chain.hoops(published("solvers.json")),
    "chain-tracks": lambda: chain.tracks(published("solvers.json")),
    "proven": chain.proven,
    "environments": lambda: environments(published("envs.json")),
    "full": lambda: full(published("benchmark-full.json")),
    "learners": lambda: learners(published("learners.json")),
    "trainings": lambda: trainings(published("trainings.json")),
    "pretrained": lambda: pretrained(PRETRAINED),
    "demonstrations": lambda: demos(published("demos.json")),
    **{
        f"{kind.__name__}-defaults": lambda kind=kind: defaults(kind)  # type: ignore[misc]
        for kind in (
            Quadrotor, Hoop, Tolerance, Scenario, Distribution, Disturbances, PPOConfig, CloneConfig, DaggerConfig,
        )
    },
}  # fmt: skip
"""The generated parts of the pages, by name; a part may stand in several pages."""


def pages() -> list[Path]:
    """Return the pages with generated parts: README.md, then docs/*.md."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks_in(text: str) -> list[str]:
    """Return the names of the blocks of a page, in order."""
    return [found[1] for found in BLOCK.findall(text)]


def filled(text: str, page: Path) -> str:
    """Return the text of a page with its blocks replaced; links to files become relative to the page's folder.

    Raises:
        ValueError: for a block of an unknown name, and for a marker without its pair.
    """
    unknown = sorted(set(blocks_in(text)) - set(BLOCKS))
    if unknown:
        raise ValueError(f"{page.name}: unknown block {unknown[0]!r}; known: {', '.join(BLOCKS)}")
    lone = MARKER.findall(BLOCK.sub("", text))
    if lone:
        raise ValueError(f"{page.name}: {lone[0]} has no pair; a block is <!-- NAME --> ... <!-- /NAME -->")
    up = "../" * len(page.parent.relative_to(ROOT).parts)

    def replaced(found: re.Match[str]) -> str:
        block = BLOCKS[found[2]]().replace("](experiments/", f"]({up}experiments/")
        return f"{found[1]}{block}\n{found[4]}"

    return BLOCK.sub(replaced, text)


def publish() -> None:
    """Copy new results to the published ones, rebuild tables and records, and draw the pictures.

    The pictures need the extra `figures` and a Chromium.
    """
    for name in FILES:
        if (REPOSITORY_RESULTS / name).exists():
            write_text(PUBLISHED / name, (REPOSITORY_RESULTS / name).read_text(encoding="utf-8"))
    for page in pages():
        write_text(page, filled(page.read_text(encoding="utf-8"), page))
    records.refresh(records.RECORDS)
    draw(PUBLISHED)


def draw(folder: Path) -> None:
    """Draw all pictures of the published results to a folder."""
    benchmark = published("benchmark.json")
    write_text(folder / "scenarios.svg", sheet())
    write_text(folder / "tracks.svg", tracks())
    pictures.draw(folder, benchmark, published("paper.json"))
    learner_figure.draw(folder, published("learners.json"))
    study_figure.draw(folder, published("benchmark-full.json"))
    chain.draw(folder, published("solvers.json"))
    corridor_figure.draw(folder, published("solvers.json"))
