"""`flatquad train`: reinforcement learning of one policy. `flatquad pretrain`: the policies of the package."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from experiments.cli.options import AsJson, ProblemName
from experiments.files import cache_folder, check_output
from experiments.formats import percent
from experiments.terminal import messages, progress_bar, show_record
from flatgym.scenarios import catalogue
from flatgym.scenarios.reference import Reference
from flatgym.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from agents.training.configs import Config
    from agents.training.train import Training

EXAMPLES = "Example: flatquad train hoop --seed 1 --folder runs/hoop-1; flatquad train random-goal --algorithm sac"
PRETRAIN_EXAMPLES = "Example: flatquad pretrain hoop climb --out my-policies"


def train_policy(
    scenario: ProblemName,
    algorithm: Annotated[str, typer.Option(help="ppo, sac, td3, tqc, crossq, dqn or qrdqn.")] = "ppo",
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
    turns: Annotated[
        int | None,
        typer.Option(help="Whole turns of the tilt that flights must make in training.", show_default="any"),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(help="Folder of the model and the checkpoints.", show_default="runs/ALGORITHM-SCENARIO-SEED"),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue from the checkpoint in the folder, perhaps to more --env-steps.")
    ] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier training in the folder.")] = False,
    tensorboard: Annotated[
        Path | None,
        typer.Option(help="Folder of TensorBoard files; needs the extra `tensorboard`.", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Train a policy and save the best one; an interrupted training continues with --resume and ends the same."""
    from agents.training.checkpoints import checkpoint_file
    from agents.training.configs import config_of
    from agents.training.progress import model_file
    from agents.training.train import train

    if resume and overwrite:
        raise ValueError("--resume continues a training and --overwrite replaces it: give one of them")
    wanted = {"max_seconds": seconds, "env_steps": env_steps, "turns": turns}
    config = config_of(
        algorithm,
        scenario=scenario,
        seed=seed,
        policy=policy,
        tensorboard=str(tensorboard or ""),
        folder=str(folder or Path("runs") / f"{algorithm.lower()}-{catalogue.label(scenario)}-{seed}"),
        **{name: value for name, value in wanted.items() if value is not None},
    )
    if resume and not checkpoint_file(config).exists():
        raise ValueError(
            f"{checkpoint_file(config)} does not exist: there is no training to resume; leave out --resume"
        )
    check_output(model_file(config))
    with progress_bar(lambda: kept_of(config)) as bar:
        work = bar.add_task(f"{config.algorithm} on {catalogue.label(scenario)}", total=100, note="K*")
        known = known_k_star(config.scenario)

        def watch(point: dict[str, Any]) -> None:
            share = max(point["env_steps"] / config.env_steps, point["wall_time_s"] / config.max_seconds)
            near = f"{point['steps']:.4g} steps" if point["success_rate"] else f"{point['way_left']:.3g} m left at best"
            note = f"success {point['success_rate']:.0%}, {near}"
            bar.update(work, completed=min(100, round(100 * share)), note=note)

        training = train(config, known.k_star if known else None, resume, overwrite, watch)
    show_record(training_row(training, config, known), as_json, "Trained")


def kept_of(config: Config) -> str:
    """Return what an interrupted training has written, and how it continues."""
    from agents.training.checkpoints import checkpoint_file
    from agents.training.progress import model_file

    written = [file.name for file in (model_file(config), checkpoint_file(config)) if file.exists()]
    if not written:
        return f"{config.folder} holds no model and no checkpoint yet; the same command starts over"
    kept = f"{config.folder} keeps {' and '.join(written)}"
    if checkpoint_file(config).exists():
        return f"{kept}; the same command with --resume continues from the checkpoint"
    return f"{kept}; there is no checkpoint yet, so --overwrite starts over"


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


def pretrain(
    names: Annotated[list[str], typer.Argument(metavar="NAME", help="Scenarios, own files too, and distributions.")],
    seed: Annotated[int, typer.Option(help="Seed of the training.")] = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the policies and their cards.", show_default="that of the package")
    ] = None,
) -> None:
    """Train pretrained policies again, one for each scenario or distribution, by DAgger under experts.

    Where DAgger has no configuration, on `random-track` and distributions of your own, PPO trains by reward. Policies
    of distributions train one after the other, those of scenarios in parallel. A scenario takes minutes, a distribution
    up to an hour.
    """
    from agents.policies.archive import PRETRAINED
    from experiments.recipes import pretraining

    problems = [catalogue.problem(name) for name in names]
    with progress_bar(f"finished policies are kept in {out or PRETRAINED}; name the others to go on") as bar:
        work = bar.add_task("policies", total=len(problems), note="")

        def watch(point: dict[str, Any]) -> None:
            success, seconds = percent(point["success_rate"]), point["wall_time_s"]
            bar.update(work, note=f"after {seconds:.0f} s: success {success}, {point['steps']:.1f} steps")

        for card in pretraining.pretrain(problems, seed, out or PRETRAINED, watch):
            score = card["score"]
            gap = "no success" if score["gap"] is None else f"gap {percent(score['gap'], sign='+')}"
            messages.print(f"{score['scenario']}: success {percent(score['success_rate'])}, {gap}", markup=False)
            bar.advance(work)
