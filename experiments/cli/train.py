"""`flatquad train`: reinforcement learning of one policy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from experiments.cli.options import AsJson, ProblemName
from experiments.files import cache_folder
from experiments.terminal import progress_bar, show_record
from flatgym.scenarios import catalogue
from flatgym.scenarios.reference import Reference
from flatgym.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from agents.training.configs import Config
    from agents.training.train import Training

EXAMPLES = "Example: flatquad train hoop --seed 1 --folder runs/hoop-1; flatquad train random-goal --algorithm sac"


def train_policy(
    scenario: ProblemName,
    algorithm: Annotated[str, typer.Option(help="ppo, sac, td3 or tqc.")] = "ppo",
    seed: Annotated[int, typer.Option(help="Seed of initial states, network and exploration.")] = 0,
    seconds: Annotated[
        float | None,
        typer.Option(help="Wall time after which training stops, in seconds.", show_default="of the algorithm"),
    ] = None,
    env_steps: Annotated[
        int | None, typer.Option(help="Environment steps of the whole training.", show_default="of the algorithm")
    ] = None,
    policy: Annotated[
        str,
        typer.Option(
            help="Policy to start from: the name of a pretrained one, or a zip of your own; a zip can run code.",
            show_default=False,
        ),
    ] = "",
    folder: Annotated[
        Path | None,
        typer.Option(help="Folder of the model and the checkpoints.", show_default="runs/ALGORITHM-SCENARIO-SEED"),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from the checkpoint in the folder.")] = False,
    as_json: AsJson = False,
) -> None:
    """Train a policy and save the best one; an interrupted training continues with --resume and ends the same."""
    from agents.training.configs import config_of
    from agents.training.train import train

    wanted = {"max_seconds": seconds, "env_steps": env_steps}
    config = config_of(
        algorithm,
        scenario=scenario,
        seed=seed,
        policy=policy,
        folder=str(folder or Path("runs") / f"{algorithm.lower()}-{catalogue.label(scenario)}-{seed}"),
        **{name: value for name, value in wanted.items() if value is not None},
    )
    with progress_bar() as bar:
        work = bar.add_task(f"{config.algorithm} on {catalogue.label(scenario)}", total=100, note="K*")
        known = known_k_star(config.scenario)

        def watch(point: dict[str, Any]) -> None:
            share = max(point["env_steps"] / config.env_steps, point["wall_time_s"] / config.max_seconds)
            note = f"success {point['success_rate']:.0%}, {point['steps']:.4g} steps"
            bar.update(work, completed=min(100, round(100 * share)), note=note)

        training = train(config, known.k_star if known else None, resume, watch)
    show_record(training_row(training, config, known), as_json, "Trained")


def known_k_star(problem: str) -> Reference | None:
    """Return the best-known solution of a scenario, computed if it has no name; None for a distribution."""
    from agents.evaluation.optima import best_known

    task = catalogue.problem(problem)
    return best_known(task, cache_folder()) if isinstance(task, Scenario) else None


def training_row(training: Training, config: Config, known: Reference | None) -> dict[str, Any]:
    """Return what a training reached, by column; its gap is None without a known K* or a success."""
    best = training.best
    return {
        "scenario": catalogue.label(config.scenario),
        "algorithm": config.algorithm,
        "seed": config.seed,
        "success_rate": best["success_rate"] if best else 0.0,
        "steps": best["steps"] if best else None,
        "k_star": known.k_star if known else None,
        "gap": known.gap(best["steps"]) if known and best else None,
        "env_steps": training.env_steps,
        "wall_time_s": round(training.wall_time_s, 1),
        "model": str(training.model),
    }
