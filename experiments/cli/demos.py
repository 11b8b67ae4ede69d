"""`flatquad demos`: best-known flights as a Minari dataset."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import pandas as pd
import typer
from rich.progress import Progress

from experiments.cli.options import AsJson, Backend, Jobs, ProblemName
from experiments.files import check_output
from experiments.terminal import messages, progress_bar, show

if TYPE_CHECKING:
    from agents.demonstrations import Demonstration

EXAMPLES = "Example: flatquad demos hoop -n 8; flatquad demos random-goal -n 1000 --export goals.csv"


def demos(
    scenario: ProblemName,
    number: Annotated[int, typer.Option("-n", "--number", min=1, help="Number of flights.")] = 8,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Seed of the starts, scenarios and perturbations.",
            show_default="0, or with --append the first unused one",
        ),
    ] = None,
    out: Annotated[str, typer.Option(help="Minari id of the dataset.", show_default="named after the scenario")] = "",
    append: Annotated[bool, typer.Option("--append", help="Add the flights to an existing dataset.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing dataset.")] = False,
    start_spread: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="Largest distance of a start from the scenario's own, in metres.",
            show_default="0.5, or 0 for a distribution",
        ),
    ] = None,
    perturbed: Annotated[
        int, typer.Option(min=0, help="Perturbed copies of each flight, replanned from the perturbed state.")
    ] = 0,
    proof_time: Annotated[float, typer.Option(min=0.0, help="Time budget of each proof of K*, in seconds.")] = 0.0,
    jobs: Jobs = -1,
    backend: Backend = "loky",
    export: Annotated[
        Path | None, typer.Option(help="Also write the dataset to a .csv or .parquet file.", show_default=False)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Record flights in K* steps, the fewest known, as a Minari dataset.

    An existing dataset stays as it is unless --append or --overwrite is given. Finished flights are stored beside
    Minari's datasets, so an interrupted run resumes.
    """
    from agents import demonstrations
    from agents.demonstrations.tables import check_export

    name, begun = demonstrations.dataset_id(scenario, out or None), time.perf_counter()
    if append and overwrite:
        raise ValueError("--append keeps the dataset and --overwrite replaces it: give one of them")
    if export is not None:
        check_output(check_export(export))
    if_exists = "append" if append else "replace" if overwrite else "fail"
    before = demonstrations.stored_dataset(scenario, name, if_exists)
    if seed is None:
        seed = 0 if before is None else demonstrations.next_seed(before)
    kept = f"finished flights are kept in {demonstrations.flights_folder()}; the same command continues"
    with progress_bar(kept) as bar:
        flights = plan_with_rate(
            bar,
            scenario,
            number,
            seed,
            spread=start_spread,
            own_start=before is None,
            perturbed=perturbed,
            time_budget=proof_time,
            jobs=jobs,
            backend=backend,
        )
        writing = bar.add_task(f"recording {name}", total=len(flights), note="")
        dataset = demonstrations.record(
            scenario,
            flights,
            name,
            if_exists=if_exists,
            progress=lambda done, _: bar.update(writing, completed=done),
        )
    episodes = int(dataset.total_episodes)
    row = {
        "dataset": dataset.id,
        "episodes": episodes,
        "steps": int(dataset.total_steps),
        "proven": round(episodes * dataset.storage.metadata["proven_share"]),
        "wall_time_s": time.perf_counter() - begun,
    }
    if export is not None:
        messages.print(f"table: {demonstrations.export(dataset, export)}", soft_wrap=True)
    titles = {"dataset": "dataset", "episodes": "episodes", "steps": "steps", "proven": "K* proven"}
    show(pd.DataFrame([row]), as_json, "Recorded", titles | {"wall_time_s": "wall time [s]"})


def plan_with_rate(bar: Progress, scenario: str, number: int, seed: int, **options: Any) -> list[Demonstration]:
    """Plan the flights of a dataset; the bar shows how many are found per second.

    Args:
        bar: where to show the progress.
        scenario, number, seed, options: as in `agents.demonstrations.plan`.
    """
    from agents import demonstrations

    begun = time.perf_counter()
    work = bar.add_task(f"demonstrations of {scenario}", total=number * (1 + options["perturbed"]), note="")
    stored: list[int] = []  # number of flights of an interrupted run

    def progress(done: int, of: int) -> None:
        if not stored:
            stored.append(done - 1)
        rate = (done - stored[0]) / (time.perf_counter() - begun)
        bar.update(work, completed=done, total=of, note=f"{rate:.1f} flights/s")

    folder = demonstrations.flights_folder()
    return demonstrations.plan(scenario, number, seed, store=folder, progress=progress, **options)
