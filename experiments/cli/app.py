"""The command `flatquad`: each sub-command is a plain function in a module of its own, registered here.

Exit status: 0 done, 1 failed (such as no certified flight), 2 bad arguments.
"""

from __future__ import annotations

import sys
import warnings

import typer
from rich.text import Text

import optimal
from experiments.cli import (
    benchmark,
    demos,
    evaluate,
    measure,
    paper,
    play,
    problems,
    publish,
    report,
    solve,
    train,
    verify,
)
from experiments.terminal import messages


def reflow(text: str) -> str:
    """Return a docstring with one line for each paragraph; Typer keeps the line breaks of all but the first."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="FlatQuad: how far from time-optimal is a learned quadrotor policy?",
    rich_markup_mode="rich",
)

for name, command, examples in (
    ("list", problems.list_problems, problems.EXAMPLES),
    ("init", problems.init, problems.INIT_EXAMPLES),
    ("show", problems.show_problem, problems.SHOW_EXAMPLES),
    ("solve", solve.solve, solve.EXAMPLES),
    ("paper", paper.paper, paper.EXAMPLES),
    ("demos", demos.demos, demos.EXAMPLES),
    ("train", train.train_policy, train.EXAMPLES),
    ("evaluate", evaluate.evaluate, evaluate.EXAMPLES),
    ("verify", verify.verify, verify.EXAMPLES),
    ("benchmark", benchmark.benchmark, benchmark.EXAMPLES),
    ("report", report.report, report.EXAMPLES),
    ("play", play.play, play.EXAMPLES),
    ("pretrain", train.pretrain, train.PRETRAIN_EXAMPLES),
    ("publish", publish.publish, publish.EXAMPLES),
):
    app.command(name, help=reflow(command.__doc__ or ""), epilog=examples)(command)
app.add_typer(measure.app, name="measure", epilog=measure.EXAMPLES)


def main() -> None:
    """Run the command; an error becomes a sentence on standard error and an exit status."""
    # joblib warns when it replaces a worker whose memory has grown. The batch continues, so there is nothing to do.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
    try:
        app()
    except ValueError as error:
        fail("error: ", error, 2)
    except (optimal.SolveFailed, ImportError, OSError) as error:
        fail("failed: ", error, 1)


def fail(kind: str, error: Exception, status: int) -> None:
    """Print an error and end the process."""
    messages.print(Text.assemble((kind, "bold red"), str(error)))
    sys.exit(status)


if __name__ == "__main__":
    main()
