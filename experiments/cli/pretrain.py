"""`flatquad pretrain`: the policies that come with the package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from experiments.formats import percent
from experiments.terminal import messages, progress_bar

EXAMPLES = "Example: flatquad pretrain hoop climb --out my-policies"


def pretrain(
    names: Annotated[list[str], typer.Argument(metavar="NAME", help="Scenarios and distributions.")],
    seed: Annotated[int, typer.Option(help="Seed of the training.")] = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the policies and their cards.", show_default="that of the package")
    ] = None,
) -> None:
    """Train pretrained policies again: DAgger under experts, one policy for each scenario or distribution.

    Policies of distributions train one after the other on all cores, those of scenarios in parallel. A scenario takes
    minutes, a distribution up to an hour.
    """
    from agents.policies.archive import PRETRAINED
    from experiments.recipes import pretraining
    from flatgym.scenarios import catalogue

    problems = [catalogue.problem(name).name for name in names]
    with progress_bar() as bar:
        work = bar.add_task("policies", total=len(problems), note="")

        def watch(point: dict[str, Any]) -> None:
            success, seconds = percent(point["success_rate"]), point["wall_time_s"]
            bar.update(work, note=f"after {seconds:.0f} s: success {success}, {point['steps']:.1f} steps")

        for card in pretraining.pretrain(problems, seed, out or PRETRAINED, watch):
            score = card["score"]
            gap = "no success" if score["gap"] is None else f"gap {percent(score['gap'], sign='+')}"
            messages.print(f"{score['scenario']}: success {percent(score['success_rate'])}, {gap}", markup=False)
            bar.advance(work)
