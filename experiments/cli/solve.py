"""`flatquad solve`: the time-optimal flight of a scenario, with certificate and lower bound."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import optimal
from experiments.cli.options import AsJson, ScenarioName
from experiments.files import cache_folder, check_output
from experiments.terminal import messages, progress_bar, show_record
from flatgym.scenarios.catalogue import scenario as named
from flatgym.validation import positive
from optimal.flights.export import FORMATS
from optimal.store import Store

if TYPE_CHECKING:
    from optimal.flat.moving_corridor import CorridorStep

EXAMPLES = "Example: flatquad solve hoop --out hoop.csv; flatquad solve hoop --steps --out held.csv"
DT = 0.01
"""Default time between the rows of a sampled flight [s]."""


def solve(
    scenario: ScenarioName,
    method: Annotated[str, typer.Option(help="shooting; flat: the paper's eq. (10); or pontryagin.")] = "shooting",
    limits: Annotated[
        str, typer.Option(help="For flat only: certified, or nodes: at grid nodes only, as published.")
    ] = "certified",
    corridor: Annotated[
        str | None,
        typer.Option(
            help="For flat only: flight, corridors around a flight; or fixed, the paper's outer paths and start.",
            show_default="flight; fixed with limits at nodes",
        ),
    ] = None,
    steps: Annotated[bool, typer.Option("--steps", help="Also find K*, the fewest environment steps.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Write a .csv, .json or .npz file: the flight sampled every --dt seconds, a reference to track; with "
            "--steps the flight in K* steps, whose controls can be held.",
            show_default=False,
        ),
    ] = None,
    dt: Annotated[
        float | None, typer.Option(help="Time between the rows of a sampled flight, in seconds.", show_default=f"{DT}")
    ] = None,
    gap: Annotated[float, typer.Option(help="Relative gap at which the proof of the lower bound stops.")] = 1e-3,
    proof_time: Annotated[float, typer.Option(help="Time budget of each proof, in seconds.")] = 10.0,
    as_json: AsJson = False,
) -> None:
    """Find the time-optimal flight of a scenario, certify it, and prove a lower bound on the flight time."""
    task = named(scenario)
    spacing = positive("solve", "dt", DT if dt is None else dt)
    if steps and out is not None and dt is not None:
        raise ValueError(
            f"--dt samples the flight, but --steps --out writes steps of {task.dt} s: leave one of them out"
        )
    if out is not None:
        check_output(out, FORMATS)
    with progress_bar() as bar:
        progress = bar.add_task(f"solving {scenario}", total=None, note="")

        def show(step: CorridorStep) -> None:
            bar.update(progress, note=f"T = {step.solution.time:.4f} s")

        solution = optimal.solve(
            task, method, corridor=corridor, checks=limits, callback=show if method == "flat" else None, max_gap=gap,
            time_budget=proof_time,
        )  # fmt: skip
        row = solution.row()
        if steps:
            fewest = optimal.fewest_steps(task, time_budget=proof_time)
            row |= {"k_star": fewest.steps, "k_lower_bound": fewest.lower_bound, "proven": fewest.proven}
    if out is not None and steps:
        optimal.save(fewest, out)
        messages.print(f"flight: {out}, controls to hold for {fewest.steps} steps of {task.dt} s", soft_wrap=True)
    elif out is not None:
        assert solution.trajectory is not None
        optimal.save(solution.trajectory.sample(spacing), out)
        messages.print(
            f"flight: {out}, sampled every {spacing:g} s: a reference to track; held, its controls miss the goal "
            "(--steps writes controls to hold)",
            soft_wrap=True,
        )
    show_record(row, as_json, solution.headline)
    keep([solution] if method == "shooting" else [], gap, proof_time)
    keep([fewest] if steps else [], gap, proof_time)


def keep(answers: Sequence[optimal.Solution | optimal.FewestSteps], *options: float) -> None:
    """Store answers where `flatquad show`, training and scores find them, by the content of their scenario."""
    for answer in answers:
        try:
            Store(cache_folder(), {"ask": f"flatquad solve: {type(answer).__name__}", "options": options}).write(answer)
        except OSError as error:
            messages.print(f"not kept for later commands: {error}", soft_wrap=True)
