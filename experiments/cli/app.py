"""The command `flatquad`: a thin skin over the packages, a table or JSON for every answer.

Exit status: 0 done, 1 failed (no certified flight, say), 2 bad arguments.
"""

from __future__ import annotations

import sys

import typer
from rich.markup import escape

import optimal
from experiments.cli import benchmark, demos, evaluate, paper, play, problems, report, solve, train
from experiments.terminal import messages

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="FlatQuad: how far from time-optimal is a learned quadrotor policy?",
    rich_markup_mode="rich",
)

for name, call, examples in (
    ("list", problems.list_problems, problems.EXAMPLES),
    ("solve", solve.solve, solve.EXAMPLES),
    ("paper", paper.paper, paper.EXAMPLES),
    ("demos", demos.demos, demos.EXAMPLES),
    ("train", train.train, train.EXAMPLES),
    ("evaluate", evaluate.evaluate, evaluate.EXAMPLES),
    ("benchmark", benchmark.benchmark, benchmark.EXAMPLES),
    ("report", report.report, report.EXAMPLES),
    ("play", play.play, play.EXAMPLES),
):
    app.command(name, epilog=examples)(call)


def main() -> None:
    """Run the command; turn what went wrong into a sentence and an exit status."""
    try:
        app()
    except ValueError as error:
        messages.print(f"[bold red]error:[/] {escape(str(error))}", highlight=False)
        sys.exit(2)
    except (optimal.SolveFailed, ImportError, OSError) as error:
        messages.print(f"[bold red]failed:[/] {escape(str(error))}", highlight=False)
        sys.exit(1)


if __name__ == "__main__":
    main()
