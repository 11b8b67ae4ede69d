"""TODO experiments/cli/solve.py."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import pandas as pd
import typer

import optimal
from experiments.cli.options import AsJson, Scenario
from experiments.terminal import messages, progress_bar, show, upright

EXAMPLES = "Example: flatquad solve hoop --out hoop.csv; flatquad solve horizontal-6 --method flat"


def solve(
    scenario: Scenario,
    method: Annotated[str, typer.Option(help="shooting, flat: the paper's eq. (10), or pontryagin.")] = "shooting",
    checks: Annotated[str, typer.Option(help="flat only: certified, or nodes as published.")] = "certified",
    steps: Annotated[bool, typer.Option("--steps", help="Also find K*, the fewest environment steps.")] = False,
    out: Annotated[Path | None, typer.Option(help="Write the flight to a .csv, .json or .npz file.")] = None,
    dt: Annotated[float, typer.Option(help="Time between the rows of that file [s].")] = 0.01,
    gap: Annotated[float, typer.Option(help="How close the proven lower bound is to come, relatively.")] = 1e-3,
    budget: Annotated[float, typer.Option(help="Time granted for each proof [s].")] = 10.0,
    as_json: AsJson = False,
) -> None:
    """Find the time-optimal flight of a scenario, certify it, and prove how much faster another could be."""
    with progress_bar() as bar:
        bar.add_task(f"solving {scenario}", total=None, note="")
        solution = optimal.solve(scenario, method=method, checks=checks, max_gap=gap, time_budget=budget)
        row = solution.row()
        if steps:
            fewest = optimal.fewest_steps(scenario, time_budget=budget)
            row |= {"k_star": fewest.steps, "k_lower_bound": fewest.lower_bound, "proven": fewest.proven}
    if out is not None:
        assert solution.trajectory is not None
        messages.print(f"flight: {optimal.save(solution.trajectory.sample(dt), out)}")
    show(pd.DataFrame([row]) if as_json else upright(row), as_json, solution.status.value)
