"""TODO experiments/cli/benchmark.py."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.options import AsJson, Backend, Jobs, Timeout, Trust
from experiments.terminal import RESULTS, command_line, messages, progress_bar, show
from flatgym.files import write_text

EXAMPLES = (
    "Example: flatquad benchmark; flatquad benchmark --full --only hoop random-goal/ppo; "
    "flatquad benchmark --policy mine=my_policy.zip --trust"
)


def benchmark(
    full: Annotated[bool, typer.Option("--full", help="All scenarios, all agents, three seeds: hours.")] = False,
    only: Annotated[
        list[str] | None, typer.Option(help="PROBLEM or PROBLEM/AGENT; may be given several times.")
    ] = None,
    policy: Annotated[
        list[str] | None, typer.Option(help="NAME=ZIP or NAME=MODULE:OBJECT, an agent of yours; may be repeated.")
    ] = None,
    trust: Trust = False,
    timeout: Timeout = 300.0,
    jobs: Jobs = -1,
    backend: Backend = "loky",
    out: Annotated[Path, typer.Option(help="Folder for results, their cells, and the report.")] = RESULTS,
    as_json: AsJson = False,
) -> None:
    """Solve, demonstrate, train and score: how far from optimal are PPO and the others?

    Minutes, or hours with --full. Each finished cell is a file of its own, so a killed run goes on where it was. At the
    end stand a table, a JSON and a CSV file, and a page with plots and races.
    """
    from experiments.benchmark.leaderboard import scores
    from experiments.benchmark.run import run
    from experiments.benchmark.submission import named
    from experiments.benchmark.suite import SUITES
    from experiments.files import published
    from experiments.report.page import write

    suite = SUITES["full" if full else "quick"]
    suite = replace(suite, policies=named(policy or (), trust), timeout=timeout)
    folder = out / ("benchmark-full" if full else "benchmark")
    with progress_bar() as bar:
        results = run(suite, folder, command=command_line(), bar=bar, only=only or (), jobs=jobs, backend=backend)
        work = bar.add_task("report", total=1, note="")
        table = scores(results)
        write_text(out / f"{folder.name}.csv", table.to_csv(index=False))
        page = write(out / "report.html", results, published("paper.json"))
        bar.advance(work)
    titles = {
        "problem": "on",
        "agent": "agent",
        "success_rate": "success",
        "gap": "gap",
        "gap_low": "from",
        "gap_high": "to",
        "learning_s": "learning [s]",
        "error": "error",
    }
    seen = table if as_json else table[table["condition"] == "calm"]
    show(seen, as_json, "Scores, undisturbed: gap to K*, with its 95 % interval", titles)
    messages.print(f"results: {out.resolve()}\nreport: {page.resolve()}", soft_wrap=True)
    if any(cell.get("error") for cell in results["cells"]):
        raise typer.Exit(1)
