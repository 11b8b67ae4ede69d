"""Arguments and options that several commands share, and how their help is printed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from typer.core import TyperCommand

HELP_OPTIONS = {"help_option_names": ["-h", "--help"]}

ScenarioName = Annotated[
    str, typer.Argument(help="A scenario: a name that `flatquad list` shows, or a file.", show_default=False)
]
ProblemName = Annotated[
    str,
    typer.Argument(
        help="A scenario or distribution: a name that `flatquad list` shows, or a file.", show_default=False
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
Jobs = Annotated[int, typer.Option(help="Worker processes; -1 uses all cores.")]
Backend = Annotated[str, typer.Option(help="loky: processes of this machine; ray: a Ray cluster, that of RAY_ADDRESS.")]
Trust = Annotated[bool, typer.Option("--trust", help="Load policy zips from outside the package; they can run code.")]
Normalize = Annotated[
    str, typer.Option(help="File of VecNormalize statistics; needs --trust.", show_default="the one beside the zip")
]
Timeout = Annotated[float, typer.Option(min=1.0, help="Time limit for the episodes of an external policy, in seconds.")]
Quick = Annotated[bool, typer.Option("--quick", help="Small sizes, to see that everything runs.")]
ResultsFile = Annotated[Path | None, typer.Option("--out", help="The JSON file to write.", show_default=False)]


class Command(TyperCommand):
    """A command whose help has no markup: brackets, such as those of a unit, are printed."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.help, self.epilog = escape(self.help or ""), escape(self.epilog or "")
        for parameter in self.params:
            parameter.help = escape(parameter.help or "")  # type: ignore[attr-defined]
