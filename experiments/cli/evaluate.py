"""`flatquad evaluate`: the score of one policy."""

from __future__ import annotations

from math import isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import pandas as pd
import typer
from rich.progress import Progress
from rich.text import Text

import flatgym
from experiments.cli.options import AsJson, Normalize, Timeout, Trust
from experiments.files import cache_folder, check_output
from experiments.terminal import cell, command_line, messages, paragraph, progress_bar, show, table
from flatgym.scenarios import catalogue
from flatgym.scenarios.reference import EVALUATION_SEED

if TYPE_CHECKING:
    from experiments.scoring.submission import Submission

COMPARED_WITH = ("pretrained", "expert", "open-loop", "pd", "hover", "random")
"""Agents beside the policy in its report."""
STATISTICS = (
    "Steps, K* and gap are interquartile means over the episodes that reached the goal. Brackets hold 95 % bootstrap "
    "intervals over the episodes."
)
EXAMPLES = (
    "Example: flatquad evaluate my_policy.zip --scenario hoop --trust --report mine.html; "
    "flatquad evaluate my_policy.onnx --scenario hoop; flatquad evaluate my_module:policy --scenario random-goal; "
    "flatquad evaluate --pretrained hoop"
)


def evaluate(
    policy: Annotated[
        str,
        typer.Argument(
            help="A zip of Stable-Baselines3, which needs --trust; a TorchScript or ONNX file; or module:object.",
            show_default=False,
        ),
    ] = "",
    scenario: Annotated[
        str, typer.Option(help="Name or file of a scenario or distribution.", show_default="the policy's own")
    ] = "",
    pretrained: Annotated[str, typer.Option(help="Name of a pretrained policy.", show_default=False)] = "",
    agent: Annotated[
        str,
        typer.Option(
            help="expert: LQR around a flight in few steps with a margin to the hoops; expert-no-margin: around the K* "
            "flight; pd: cascaded PD controller; hover: stands still; or random: random actions.",
            show_default=False,
        ),
    ] = "",
    episodes: Annotated[
        int | None,
        typer.Option(min=1, help="Number of episodes.", show_default="of the protocol: 1, 1000, 300, or 100"),
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the first episode; training uses smaller ones.")
    ] = EVALUATION_SEED,
    trust: Trust = False,
    normalize: Normalize = "",
    algorithm: Annotated[
        str, typer.Option(help="Algorithm of the zip, if it does not show it.", show_default=False)
    ] = "",
    timeout: Timeout = 300.0,
    k_star_time: Annotated[
        float, typer.Option(min=0.0, help="Time limit for computing K* of a task of your own, in seconds.")
    ] = 60.0,
    report: Annotated[
        Path | None,
        typer.Option(
            help="Also write a page that compares the policy with ours, its scores beside it.", show_default=False
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Also write the flights to a JSON file, for `flatquad verify`.", show_default=False),
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

    Your policy is a Stable-Baselines3 zip, a TorchScript or ONNX file, or any object with predict(observations). It
    runs in a process of its own and may crash or hang.
    """
    from experiments.scoring.score import record, score
    from experiments.scoring.submission import Submission

    submitted = Submission(
        policy, pretrained, agent, scenario, trust, normalize, algorithm, episodes, seed,
        flatgym.Disturbances(wind, thrust_gain, mass, action_delay, sensor_noise),
    )  # fmt: skip
    if out is not None:
        check_output(out)
    if report is not None:
        check_output(report, (".html",))
    with progress_bar() as bar:
        bar.add_task("episodes", total=None, note="")
        scored = score(submitted, cache_folder(), timeout, k_star_time, check=out is None)
        if out is not None:
            record(submitted, scored, out, command_line())
    row = scored.row | {"command": command_line()}
    if as_json:
        show(pd.DataFrame([row]), as_json)
    else:
        head = ["task", "agent", "episodes", "success", "steps", "K*", "gap to K*", "outcomes"]
        table("Score", head, [score_cells(row)], optional=("episodes", "K*", "steps"))
        if row["episodes"] > 1:
            paragraph(STATISTICS)
    for note in scored.notes:
        messages.print(Text.assemble(("note: ", "bold yellow"), note), soft_wrap=True)
    if out is not None:
        messages.print(f"flights: {out.resolve()}", soft_wrap=True)
    if report is not None:
        with progress_bar() as bar:
            page = write_page(submitted, report, command=command_line(), timeout=timeout, bar=bar)
        beside = page.resolve().with_suffix("")
        messages.print(f"report: {page.resolve()}", soft_wrap=True)
        messages.print(f"its scores: {beside}.json, and {beside}/, from which a further run resumes", soft_wrap=True)


def score_cells(row: dict[str, Any]) -> list[str]:
    """Return the cells of a score row as JSON holds it."""
    from experiments.benchmark.formats import format_gap, format_success

    known = {key: nan if row[key] is None else row[key] for key in ("steps", "k_star", "gap", "gap_low", "gap_high")}
    return [
        *(cell(row[key]) for key in ("scenario", "agent", "episodes")),
        format_success(row),
        *("-" if isnan(known[key]) else f"{known[key]:.4g}" for key in ("steps", "k_star")),
        format_gap(known),
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
        policies={submission.name: submission.arguments} if submission.policy else {},
        timeout=timeout,
    )
    results = run(suite, path.with_suffix(""), command=command, bar=bar)
    known = select_problem(catalogue.label(problem), published("learners.json"))
    return write(path, merge(results, known), published("paper.json"))
