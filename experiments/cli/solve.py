"""`flatquad solve`: the time-optimal flight of a scenario, with certificate and lower bound."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import optimal
from experiments.cli.options import AsJson, ScenarioName
from experiments.terminal import messages, progress_bar, show_record

EXAMPLES = "Example: flatquad solve hoop --out hoop.csv; flatquad solve horizontal-6 --method flat"


def solve(
    scenario: ScenarioName,
    method: Annotated[str, typer.Option(help="shooting; flat: the paper's eq. (10); or pontryagin.")] = "shooting",
    limits: Annotated[
        str, typer.Option(help="For flat only: certified, or nodes: at grid nodes only, as published.")
    ] = "certified",
    steps: Annotated[bool, typer.Option("--steps", help="Also find K*, the fewest environment steps.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Write the flight to a .csv, .json or .npz file.", show_default=False)
    ] = None,
    dt: Annotated[float, typer.Option(help="Time between the rows of that file, in seconds.")] = 0.01,
    gap: Annotated[float, typer.Option(help="Relative gap at which the proof of the lower bound stops.")] = 1e-3,
    proof_time: Annotated[float, typer.Option(help="Time budget of each proof, in seconds.")] = 10.0,
    as_json: AsJson = False,
) -> None:
    """Find the time-optimal flight of a scenario, certify it, and prove a lower bound on the flight time."""
    with progress_bar() as bar:
        bar.add_task(f"solving {scenario}", total=None, note="")
        solution = optimal.solve(scenario, method=method, checks=limits, max_gap=gap, time_budget=proof_time)
        row = solution.row()
        if steps:
            fewest = optimal.fewest_steps(scenario, time_budget=proof_time)
            row |= {"k_star": fewest.steps, "k_lower_bound": fewest.lower_bound, "proven": fewest.proven}
    if out is not None:
        assert solution.trajectory is not None
        messages.print(f"flight: {optimal.save(solution.trajectory.sample(dt), out)}", soft_wrap=True)
    show_record(row, as_json, solution.status.value)
