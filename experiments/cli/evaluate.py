"""`flatquad evaluate`: the score of one policy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import pandas as pd
import typer
from rich.progress import Progress

import flatgym
from experiments.cli.options import AsJson, Timeout, Trust
from experiments.files import cache_folder
from experiments.formats import percent
from experiments.terminal import cell, command_line, messages, progress_bar, show, table
from flatgym.scenarios import catalogue
from flatgym.scenarios.reference import EVALUATION_SEED

if TYPE_CHECKING:
    from experiments.benchmark.submission import Submission

COMPARED_WITH = ("pretrained", "expert", "open-loop", "pd")
"""Agents beside the policy in its report."""
EXAMPLES = (
    "Example: flatquad evaluate my_policy.zip --scenario hoop --trust --report mine.html; "
    "flatquad evaluate my_module:policy --scenario random-goal; flatquad evaluate --pretrained hoop"
)


def evaluate(
    policy: Annotated[
        str, typer.Argument(help="A policy's zip, which needs --trust; or module:object.", show_default=False)
    ] = "",
    scenario: Annotated[
        str, typer.Option(help="Name or file of a scenario or distribution.", show_default="the policy's own")
    ] = "",
    pretrained: Annotated[str, typer.Option(help="Name of a pretrained policy.", show_default=False)] = "",
    agent: Annotated[
        str, typer.Option(help="expert: LQR around a K* flight; or pd: cascaded PD controller.", show_default=False)
    ] = "",
    episodes: Annotated[int, typer.Option(min=1, help="Number of episodes.")] = 100,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the first episode; training uses smaller ones.")
    ] = EVALUATION_SEED,
    trust: Trust = False,
    timeout: Timeout = 300.0,
    report: Annotated[
        Path | None,
        typer.Option(
            help="Also write a page that compares the policy with ours, its scores beside it.", show_default=False
        ),
    ] = None,
    wind: Annotated[float, typer.Option(help="Largest acceleration by wind, in m/s².")] = 0.0,
    mass: Annotated[float, typer.Option(help="Largest relative error of the mass.")] = 0.0,
    thrust_gain: Annotated[float, typer.Option(help="Largest relative error of the thrust.")] = 0.0,
    action_delay: Annotated[int, typer.Option(help="Largest delay of the actions, in steps.")] = 0,
    sensor_noise: Annotated[
        float, typer.Option(help="Standard deviation of the measured state, in m, m/s and rad.")
    ] = 0.0,
    as_json: AsJson = False,
) -> None:
    """Score a policy, yours or ours: success rate, steps, and the gap to K*, the fewest steps possible.

    Your policy is a Stable-Baselines3 zip or any object with predict(observations). It runs in a process of its own and
    may crash or hang.
    """
    from experiments.benchmark import submission

    submitted = submission.Submission(
        policy, pretrained, agent, scenario, trust, episodes, seed,
        flatgym.Disturbances(wind, thrust_gain, mass, action_delay, sensor_noise),
    )  # fmt: skip
    with progress_bar() as bar:
        bar.add_task("episodes", total=None, note="")
        row = submission.score(submitted, cache_folder(), timeout) | {"command": command_line()}
        if report is not None:
            page = write_page(submitted, report, command=command_line(), timeout=timeout, bar=bar)
    if as_json:
        show(pd.DataFrame([row]), as_json)
    else:
        head = ["task", "agent", "episodes", "success", "steps", "K*", "gap to K*", "outcomes"]
        table("Score", head, [score_cells(row)], optional=("episodes", "K*", "steps"))
    if report is not None:
        beside = page.resolve().with_suffix("")
        messages.print(f"report: {page.resolve()}", soft_wrap=True)
        messages.print(f"its scores: {beside}.json, and {beside}/, from which a further run resumes", soft_wrap=True)


def score_cells(row: dict[str, Any]) -> list[str]:
    """Return the cells of a score."""
    from experiments.benchmark.formats import format_percent

    return [
        *(cell(row[key]) for key in ("scenario", "agent", "episodes")),
        format_percent(row["success_rate"]),
        *("-" if pd.isna(row[key]) else f"{row[key]:.4g}" for key in ("steps", "k_star")),
        "-" if pd.isna(row["gap"]) else percent(row["gap"], sign="+"),
        ", ".join(f"{word} {count}" for word, count in row["outcomes"].items()),
    ]


def write_page(submission: Submission, path: Path, *, command: str, timeout: float, bar: Progress) -> Path:
    """Write the report of a policy beside our agents on its problem, nominal and disturbed.

    Args:
        submission: the policy and its problem.
        path: the page; results lie beside it in a folder of its name.
        command: the command line, for the record.
        timeout: as in `score`.
        bar: shows the progress.
    """
    from experiments.benchmark.results import merge, select_problem
    from experiments.benchmark.run import run
    from experiments.benchmark.suite import Suite, can_fly
    from experiments.files import published
    from experiments.report.page import write

    problem = catalogue.text(submission.problem)
    agents = dict.fromkeys([*([submission.agent] if submission.agent else []), *COMPARED_WITH])
    others = tuple(agent for agent in agents if can_fly(agent, problem))
    suite = Suite(
        "submission",
        {problem: others},
        policies={submission.name: submission.policy} if submission.policy else {},
        timeout=timeout,
    )
    results = run(suite, path.with_suffix(""), command=command, bar=bar)
    known = select_problem(catalogue.label(problem), published("learners.json"))
    return write(path, merge(results, known), published("paper.json"))
