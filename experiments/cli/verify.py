"""`flatquad verify`: replay the flights of a score file, or check a proof."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.options import AsJson, Normalize, Timeout, Trust
from experiments.files import cache_folder
from experiments.terminal import progress_bar, show_record

EXAMPLES = (
    "Example: flatquad verify score.json; flatquad verify score.json --policy my_policy.zip --trust; "
    "flatquad verify proof.json"
)
STATUS = {"verified": 0, "fragile": 1, "refused": 2}
"""Exit status by verdict."""


def verify(
    file: Annotated[
        Path, typer.Argument(help="A score file of `flatquad evaluate --out`, or a saved proof.", show_default=False)
    ],
    policy: Annotated[
        str,
        typer.Option(
            help="Also fly this policy: a zip, or module:object; it must be that of the file.", show_default=False
        ),
    ] = "",
    trust: Trust = False,
    normalize: Normalize = "",
    timeout: Timeout = 300.0,
    as_json: AsJson = False,
) -> None:
    """Replay every flight of a score file exactly, and recompute its score; or check a proof with a second checker.

    The answer is verified; fragile, where a flight depends on rounding; or refused, with the reason. The exit status is
    0, 1 or 2.
    """
    from experiments.scoring.verify_file import verify_file

    with progress_bar() as bar:
        bar.add_task(f"verifying {file.name}", total=None, note="")
        row = verify_file(file, cache_folder(), policy, trust, timeout, normalize)
    show_record(row, as_json, row["verdict"].capitalize())
    raise typer.Exit(STATUS[row["verdict"]])
