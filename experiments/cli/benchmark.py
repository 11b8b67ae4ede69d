"""`flatquad benchmark`: train and score agents, and compare them with the optimum."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from experiments.cli.options import AsJson, Backend, Jobs, Quick, Timeout, Trust
from experiments.files import USER_RESULTS, Row, check_output, published
from experiments.formats import format_percent
from experiments.terminal import command_line, messages, paragraph, progress_bar, screen, show, table
from flatgym.files import write_text

if TYPE_CHECKING:
    from experiments.benchmark.leaderboard import Leaderboard, LeaderboardRow
    from experiments.benchmark.suite import Suite

EXAMPLES = (
    "Example: flatquad benchmark; flatquad benchmark --full --only hoop --only random-goal/ppo; "
    "flatquad benchmark --policy mine=my_policy.zip --trust"
)
FILES = {"quick": "benchmark", "full": "benchmark-full", "study": "learners"}
"""Names of the results files, by suite."""


def benchmark(
    full: Annotated[bool, typer.Option("--full", help="All scenarios, all agents, three seeds: hours.")] = False,
    study: Annotated[
        bool, typer.Option("--study", help="All agents on hoop and random-goal, three seeds: an hour or two.")
    ] = False,
    quick: Quick = False,
    only: Annotated[
        list[str] | None,
        typer.Option(
            help="PROBLEM or PROBLEM/AGENT, also a file with a track of yours; may be repeated.",
            show_default="the whole suite",
        ),
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(min=1, help="Training runs of each learner.", show_default="of the suite")
    ] = None,
    policy: Annotated[
        list[str] | None,
        typer.Option(help="An agent of your own, NAME=ZIP or NAME=MODULE:OBJECT; may be repeated.", show_default=False),
    ] = None,
    trust: Trust = False,
    timeout: Timeout = 300.0,
    resume: Annotated[
        Path | None,
        typer.Option(help="Results file of an earlier run of the suite, whose cells are kept.", show_default=False),
    ] = None,
    jobs: Jobs = -1,
    backend: Backend = "loky",
    out: Annotated[Path, typer.Option(help="Folder of the results and the report.")] = USER_RESULTS,
    as_json: AsJson = False,
) -> None:
    """Solve, demonstrate, train and score: how far from the optimum are PPO and other agents?

    It takes minutes, or hours with --full. Finished cells are skipped, so an interrupted run resumes and gives the same
    result. The results are a table, a JSON and a CSV file, and a report page with plots and races.
    """
    from experiments.benchmark.leaderboard import Leaderboard, score_table
    from experiments.benchmark.results import restore
    from experiments.benchmark.run import run
    from experiments.benchmark.suite import named_policies
    from experiments.report.page import write

    if full and study:
        raise ValueError("--full and --study are two suites: give one of them")
    name = "full" if full else "study" if study else "quick"
    suite = adapted_suite(name, named_policies(policy or (), trust), timeout, seeds, quick)
    suite, wanted = suite.with_own(only or ())
    folder = out / (FILES[name] + ("-quick" if quick else ""))
    check_output(out / "report.html")
    if resume is not None:
        restore(read_results(resume, suite.name), folder)
    with progress_bar(f"finished cells and plans are kept in {folder}; the same command continues") as bar:
        results = run(suite, folder, command=command_line(), bar=bar, only=wanted, jobs=jobs, backend=backend)
        work = bar.add_task("report", total=1, note="")
        leaderboard = Leaderboard.of(results)
        scores = score_table(leaderboard)
        write_text(out / f"{folder.name}.csv", scores.to_csv(index=False))
        page = write(out / "report.html", results, published("paper.json"), leaderboard)
        bar.advance(work)
    if as_json:
        show(scores, as_json)
    else:
        show_leaderboard(leaderboard, results)
    messages.print(f"results: {out.resolve()}\nreport: {page.resolve()}", soft_wrap=True)
    if any(cell.get("error") for cell in results["cells"]):
        raise typer.Exit(1)


def read_results(path: Path, suite: str) -> Row:
    """Return the results in a file; a ValueError for another file, and for those of another suite."""
    try:
        results: Row = json.loads(path.read_text(encoding="utf-8"))
        found = results["suite"], results["cells"], results["k_star"]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ValueError(f"{path} is no results file of `flatquad benchmark`: {error!r}") from None
    if found[0] != suite:
        raise ValueError(f"{path} holds results of the suite {found[0]!r}, and this run is of {suite!r}")
    return results


def adapted_suite(name: str, policies: dict[str, Row], timeout: float, seeds: int | None, small: bool) -> Suite:
    """Return a suite by its name, with own policies and their time limit [s], other seeds, or small sizes."""
    from experiments.benchmark.suite import SMOKE_SUITE, SUITES
    from experiments.recipes.run_spec import SMOKE

    suite = SUITES[name]
    suite = replace(suite, policies=policies, timeout=timeout, seeds=seeds or suite.seeds)
    return replace(suite, name=SMOKE_SUITE, budget=SMOKE) if small else suite


def show_leaderboard(leaderboard: Leaderboard, results: Row) -> None:
    """Print the nominal scores of all agents, then the errors of those that failed."""
    from experiments.benchmark.conditions import COMBINED, NOMINAL
    from experiments.benchmark.formats import describe_disturbances
    from experiments.provenance import SMALL_SIZES

    combined = {
        (score.problem, score.agent): score.success for score in leaderboard.scores if score.condition == COMBINED
    }
    disturbances = results["conditions"][COMBINED]
    head = ["task", "agent", "success", "gap to K*", "disturbed", "training time [s]"]
    table(
        "Success and gap to K*, the fewest steps possible",
        head,
        [leaderboard_cells(row, combined.get((row.problem, row.agent))) for row in leaderboard.rows],
        optional=("training time [s]", "disturbed"),
    )
    small = f" {SMALL_SIZES}" if results["smoke"] else ""
    paragraph(
        f"Success and gap are for {NOMINAL} episodes, with 95 % bootstrap intervals where they vary; the gap is "
        f"K / K* - 1 of successful episodes. Disturbed: success with {describe_disturbances(disturbances)}.{small}"
    )
    for row in leaderboard.rows:
        for error in row.errors:
            screen.print(f"failed: {row.problem}/{row.agent}, {error}", markup=False, style="red")


def leaderboard_cells(row: LeaderboardRow, disturbed: float | None) -> Sequence[str]:
    """Return an agent's row of the printed table."""
    from experiments.benchmark.formats import format_gap, format_success

    if row.failed:
        return [row.problem, row.name, "failed", "-", "-", "-"]
    score = {
        "success_rate": row.success, "success_low": row.success_low, "success_high": row.success_high,
        "gap": row.gap, "gap_low": row.gap_low, "gap_high": row.gap_high,
    }  # fmt: skip
    time = f"{row.training_s:.0f}" if row.training_s else "-"
    return [
        row.problem,
        row.name,
        format_success(score),
        format_gap(score),
        "-" if disturbed is None else format_percent(disturbed),
        time,
    ]
