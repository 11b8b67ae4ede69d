"""TODO experiments/cli/demos.py."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import pandas as pd
import typer

from experiments.cli.options import AsJson, Backend, Jobs, Problem
from experiments.terminal import messages, progress_bar, show

EXAMPLES = "Example: flatquad demos hoop -n 8; flatquad demos random-goal -n 1000 --export goals.csv"


def demos(
    scenario: Problem,
    number: Annotated[int, typer.Option("-n", "--number", min=1, help="How many flights from rest.")] = 8,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")] = 0,
    out: Annotated[str, typer.Option(help="Minari id of the dataset; by default named after the scenario.")] = "",
    displaced: Annotated[
        float | None,
        typer.Option(
            min=0.0, help="Greatest distance of a start from the scenario's own [m]; 0.5, or 0 for a distribution."
        ),
    ] = None,
    perturbed: Annotated[
        int, typer.Option(min=0, help="How often each flight is also knocked off on its way and planned anew.")
    ] = 0,
    budget: Annotated[float, typer.Option(min=0.0, help="Time granted for each proof [s].")] = 0.0,
    jobs: Jobs = -1,
    backend: Backend = "loky",
    export: Annotated[Path | None, typer.Option(help="Write the dataset to a .csv or .parquet file too.")] = None,
    as_json: AsJson = False,
) -> None:
    """Record fewest-steps flights as a Minari dataset.

    Flights that are found are kept beside Minari's datasets, so that a run broken off goes on where it stopped.
    """
    from agents import demonstrations
    from agents.demonstrations.tables import check_export

    name, begun = demonstrations.dataset_id(scenario, out or None), time.perf_counter()
    if export is not None:
        check_export(export)
    with progress_bar() as bar:
        work = bar.add_task(f"demonstrations of {scenario}", total=number * (1 + perturbed), note="")

        found_before: list[int] = []  # flights of a run broken off

        def planned(done: int, of: int) -> None:
            if not found_before:
                found_before.append(done - 1)
            rate = (done - found_before[0]) / (time.perf_counter() - begun)
            bar.update(work, completed=done, total=of, note=f"{rate:.1f} flights/s")

        flights = demonstrations.plan(
            scenario,
            number,
            seed,
            spread=displaced,
            perturbed=perturbed,
            time_budget=budget,
            jobs=jobs,
            backend=backend,
            store=demonstrations.flights_folder(),
            progress=planned,
        )
        writing = bar.add_task(f"recorded as {name}", total=len(flights), note="")
        dataset = demonstrations.record(
            scenario, flights, name, progress=lambda done, _: bar.update(writing, completed=done)
        )
    row = {
        "dataset": dataset.id,
        "episodes": int(dataset.total_episodes),
        "steps": int(dataset.total_steps),
        "proven": sum(one.flight.proven for one in flights),
        "wall_time_s": time.perf_counter() - begun,
    }
    if export is not None:
        messages.print(f"table: {demonstrations.export(dataset, export)}", soft_wrap=True)
    show(pd.DataFrame([row]), as_json, "Recorded")
