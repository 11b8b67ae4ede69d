"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

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
Timeout = Annotated[float, typer.Option(min=1.0, help="Time limit for the episodes of an external policy, in seconds.")]
Quick = Annotated[bool, typer.Option("--quick", help="Small sizes, to see that everything runs.")]
ResultsFile = Annotated[Path | None, typer.Option("--out", help="The JSON file to write.", show_default=False)]
