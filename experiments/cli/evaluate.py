"""TODO experiments/cli/evaluate.py."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import pandas as pd
import typer
from rich.progress import Progress

import flatgym
from experiments.cli.options import AsJson, Timeout, Trust
from experiments.terminal import command_line, messages, progress_bar, show
from flatgym.scenarios import catalogue
from flatgym.scenarios.reference import EVALUATION_SEED

if TYPE_CHECKING:
    from experiments.benchmark.submission import Submission

CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "flatquad"
"""Where K* that had to be computed are kept, for the next time."""

EXAMPLES = (
    "Example: flatquad evaluate my_policy.zip --scenario hoop --trust --report mine.html; "
    "flatquad evaluate my_module:policy --scenario random-goal; flatquad evaluate --pretrained hoop"
)


def evaluate(
    policy: Annotated[
        str, typer.Argument(help="A policy's zip, whose code is run, so only with --trust; or module:object.")
    ] = "",
    scenario: Annotated[str, typer.Option(help="Name of a scenario or distribution; `flatquad list` shows them.")] = "",
    pretrained: Annotated[str, typer.Option(help="Name of a policy that came with the package.")] = "",
    agent: Annotated[str, typer.Option(help="expert: a flight in K* steps with feedback; or pd: a cascade.")] = "",
    episodes: Annotated[int, typer.Option(min=1, help="How many flights.")] = 100,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the first flight; trainings use smaller ones.")
    ] = EVALUATION_SEED,
    trust: Trust = False,
    timeout: Timeout = 300.0,
    report: Annotated[
        Path | None, typer.Option(help="Also write a page with plots and a race, yours beside expert, PD and others.")
    ] = None,
    wind: Annotated[float, typer.Option(help="Greatest acceleration by the wind [m/s^2].")] = 0.0,
    mass: Annotated[float, typer.Option(help="Greatest error of the mass, as a share.")] = 0.0,
    thrust_gain: Annotated[float, typer.Option(help="Greatest error of the thrust, as a share.")] = 0.0,
    action_delay: Annotated[int, typer.Option(help="Greatest delay of the actions [steps].")] = 0,
    sensor_noise: Annotated[float, typer.Option(help="Standard deviation of what is measured [m, m/s, rad].")] = 0.0,
    as_json: AsJson = False,
) -> None:
    """Score a policy, yours or one of ours: success, steps, and the gap to K*, the fewest steps possible.

    Yours is a zip of Stable-Baselines3, or anything with predict(observations) in a module. It flies in a process of
    its own, so that it may crash or hang.
    """
    from experiments.benchmark import submission

    asked = submission.Submission(
        policy, pretrained, agent, scenario, trust, episodes, seed,
        flatgym.Disturbances(wind, thrust_gain, mass, action_delay, sensor_noise),
    )  # fmt: skip
    with progress_bar() as bar:
        bar.add_task("flying", total=None, note="")
        rows = pd.DataFrame([submission.score(asked, CACHE, timeout) | {"command": command_line()}])
        if report is not None:
            page = write_page(asked, report, command=command_line(), timeout=timeout, bar=bar)
    titles = {
        "scenario": "scenario",
        "agent": "agent",
        "episodes": "flights",
        "success_rate": "success",
        "steps": "steps",
        "k_star": "K*",
        "gap": "gap",
        "outcomes": "outcomes",
    }
    if not as_json:
        rows["outcomes"] = [", ".join(f"{word} {n}" for word, n in counts.items()) for counts in rows["outcomes"]]
    show(rows, as_json, "Score", titles)
    if report is not None:
        messages.print(f"report: {page.resolve()}", soft_wrap=True)


BESIDE = ("pretrained", "expert", "tape", "pd")
"""Who flies beside a policy on its page."""


def write_page(contest: Submission, path: Path, *, command: str, timeout: float, bar: Progress) -> Path:
    """Write the report of a policy beside our agents on what it flies, undisturbed and disturbed.

    Args:
        contest: who flies what.
        path: the page; results lie beside it in a folder of its name.
        command: what the user typed.
        timeout: as in `score`.
        bar: shows how far the work is.
    """
    from experiments.benchmark.results import merged, only
    from experiments.benchmark.run import run
    from experiments.benchmark.suite import Suite, can_fly
    from experiments.files import published
    from experiments.report.page import write

    problem = catalogue.problem(contest.problem).name
    beside = tuple(agent for agent in BESIDE if can_fly(agent, problem) and agent != contest.name)
    suite = Suite(
        "mine",
        {problem: beside},
        policies={contest.name: contest.policy} if contest.policy else {},
        timeout=timeout,
    )
    results = run(suite, path.with_suffix(""), command=command, bar=bar)
    known = only(problem, published("learners.json"))
    return write(path, merged(results, known), published("paper.json"))
