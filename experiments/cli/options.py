"""TODO experiments/cli/options.py."""

from __future__ import annotations

from typing import Annotated

import typer

Scenario = Annotated[str, typer.Argument(help="Name of a scenario; `flatquad list` shows them.", show_default=False)]
Problem = Annotated[
    str, typer.Argument(help="Name of a scenario or distribution; `flatquad list` shows them.", show_default=False)
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
Jobs = Annotated[int, typer.Option(help="Worker processes; -1 is one for each core.")]
Backend = Annotated[str, typer.Option(help="loky: this machine, or ray: a Ray cluster.")]
Trust = Annotated[bool, typer.Option("--trust", help="Load zips: I know who wrote them.")]
Timeout = Annotated[float, typer.Option(min=1.0, help="How long the flights of a policy of yours may take [s].")]
