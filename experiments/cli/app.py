"""The command `flatquad`: each sub-command is a plain function in a module of its own, registered here.

Exit status: 0 done, 1 failed (such as no certified flight), 2 bad arguments, 130 interrupted.
"""

from __future__ import annotations

import os
import signal
import sys
import warnings
from typing import Annotated

import typer
from rich.text import Text
from typer import rich_utils

import optimal
from experiments import IS_COMMAND
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
from experiments.cli.options import HELP_OPTIONS, Command
from experiments.interrupts import interruptible
from experiments.terminal import COLORS, messages, screen
from flatgym import __version__


def reflow(text: str) -> str:
    """Return a docstring with one line for each paragraph; Typer keeps the line breaks of all but the first."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


SILENT = ("A worker stopped while some jobs", "resource_tracker")
"""Beginnings of warnings that need no action: joblib replaces a worker whose memory has grown, and shared memory is
freed after an interrupt."""

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings=HELP_OPTIONS,
)


def print_version(wanted: bool) -> None:
    """Print the version and end the command."""
    if wanted:
        screen.print(f"flatquad {__version__}")
        raise typer.Exit


@app.callback()
def flatquad(
    version: Annotated[
        bool, typer.Option("--version", callback=print_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """FlatQuad: how far from time-optimal is a learned quadrotor policy?"""


rich_utils.COLOR_SYSTEM = COLORS  # help obeys NO_COLOR as tables do

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
    app.command(name, cls=Command, help=reflow(command.__doc__ or ""), epilog=examples)(command)
app.add_typer(measure.app, name="measure", epilog=measure.EXAMPLES)


def main() -> None:
    """Run the command, silent about what needs no action, and end it at Ctrl-C."""
    for start in SILENT:
        warnings.filterwarnings("ignore", start, UserWarning)
    os.environ.setdefault("PYTHONWARNINGS", ",".join(f"ignore:{start}" for start in SILENT))  # of worker processes
    try:
        with interruptible():
            run()
    finally:
        if IS_COMMAND:  # the work is done
            signal.signal(signal.SIGINT, signal.SIG_DFL)


def run() -> None:
    """Run the command; an error becomes a sentence on standard error and an exit status."""
    try:
        app()
    except ValueError as error:
        fail("error: ", error, 2)
    except (optimal.SolveFailed, ImportError, OSError) as error:
        fail("failed: ", error, 1)


def fail(kind: str, error: Exception, status: int) -> None:
    """Print an error and end the process."""
    messages.print(Text.assemble((kind, "bold red"), str(error)), soft_wrap=True)
    sys.exit(status)


if __name__ == "__main__":
    main()
