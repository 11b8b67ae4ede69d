"""The policies that come with the package: how each was made, by one command.

    python -m experiments.recipes.pretraining hoop climb --out agents/pretrained

On a named scenario: the optimal flight, planned through hoops narrower than they are and clear of the floor, so that a
learner may err; DAgger under the regulator about it, first from starts scattered widely and then closely, until the
learner flies in as many steps or time is up. On a distribution: optimal flights of many drawn scenarios, and DAgger
under the regulators about them, under whoever plans anew behind the last hoop, and under the controller that leads
back to a missed one. Beside each policy lies a card with what made it: configuration, seed, command, versions, wall
time, score.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import joblib
import torch

from agents import policies
from agents.evaluation.checks import Point
from agents.evaluation.scores import evaluate
from agents.imitation.advisers import guided, regulated
from agents.imitation.cloning import student
from agents.imitation.dataset_aggregation import DaggerConfig, dagger
from agents.imitation.selection import BestPolicy
from agents.policies import archive
from experiments.files import plain, write_json
from experiments.provenance import provenance
from experiments.recipes.margins import INNER, inner, teacher
from experiments.terminal import progress_bar
from flatgym import DISTRIBUTIONS, SCENARIOS
from optimal.batch import fewest_steps_many

SPECIAL = DaggerConfig(gradient_steps=1500, rounds=24, max_seconds=300.0)
"""What a policy for one scenario is trained with at first."""
PRECISE = DaggerConfig(gradient_steps=2000, rounds=60, learning_rate=1e-3, max_seconds=800.0)
"""What it is trained with then, where it is not at K* yet; seconds count from the beginning of the first."""
STAGES = ((SPECIAL, 0.05), (PRECISE, 0.02))
"""Both, and how far starts and actions are scattered, as `agents.imitation.advisers.regulated` has it."""
WIDE = DaggerConfig(
    width=256,
    observation_scale=6.0,
    guidance=True,
    batch_size=1024,
    gradient_steps=3500,
    rounds=16,
    max_seconds=3600.0,
    n_eval_episodes=300,
)
GENERAL = {"random-goal": replace(WIDE, width=160, rounds=8), "random-hoops": WIDE}
"""What policies for distributions are trained with."""
FLIGHTS = {"random-goal": 2600, "random-hoops": 3000}
"""Optimal flights to begin with."""
EPISODES = {"random-goal": 1000, "random-hoops": 300}
"""Flights by which a policy for a distribution is scored, unseen, of known K*."""
STORE = Path("experiments/results/flights")
"""Where optimal flights of drawn scenarios are kept."""


def specialist(name: str, seed: int, out: Path, command: str) -> dict[str, Any]:
    """Train a policy for one scenario, write it and its card, and return the card."""
    torch.set_num_threads(1)
    began, target = time.perf_counter(), SCENARIOS[name]
    stages = [(replace(stage, scenario=name, seed=seed), scatter) for stage, scatter in STAGES]
    flight = teacher(target)
    keeper = BestPolicy(stages[0][0], target=flight.steps)
    model = student(stages[0][0])
    for config, scatter in stages:
        if not keeper.satisfied:
            model = dagger(model, regulated([flight], scatter=scatter, noise=scatter, seed=seed), config, keeper)
    wall_time = time.perf_counter() - began
    policies.save(model, out / f"{name}.zip", name)
    scores = evaluate(
        model,
        name,
        1,
        agent=name,
        algorithm="DAgger",
        env_steps=keeper.env_steps,
        wall_time_s=round(wall_time, 1),
        command=command,
    )
    return card(
        out / f"{name}.json", seed, command, [config for config, _ in stages], keeper.curve, dict(scores.iloc[0])
    )


def generalist(
    name: str, seed: int, out: Path, command: str, jobs: int = -1, watch: Callable[[Point], Any] = lambda _: None
) -> dict[str, Any]:
    """Train a policy for a distribution, write it and its card, and return the card; `watch` is told each round."""
    torch.set_num_threads(joblib.effective_n_jobs(jobs))
    began, distribution = time.perf_counter(), DISTRIBUTIONS[name]
    config = replace(GENERAL[name], scenario=name, seed=seed)
    drawn = [inner(distribution.scenario(i), INNER) for i in range(FLIGHTS[name])]
    before = len(list(STORE.glob(f"{name}-*.json")))
    flights = fewest_steps_many(drawn, jobs=jobs, store=STORE)
    planned = time.perf_counter()
    keeper = BestPolicy(config, watch=watch)
    model = dagger(student(config), guided(flights, distribution, seed=seed, jobs=jobs), config, keeper)
    wall_time = time.perf_counter() - began
    policies.save(archive.rounded(model), out / f"{name}.zip", name)
    scores = evaluate(
        model,
        name,
        EPISODES[name],
        agent=name,
        algorithm="DAgger",
        env_steps=keeper.env_steps,
        wall_time_s=round(wall_time, 1),
        command=command,
    )
    return card(
        out / f"{name}.json",
        seed,
        command,
        [config],
        keeper.curve,
        dict(scores.iloc[0]),
        planning_s=round(planned - began, 1),
        flights=len(flights),
        planned_before=before,
    )


def card(
    path: Path,
    seed: int,
    command: str,
    configs: Sequence[Any],
    curve: list[Point],
    score: dict[str, Any],
    **further: Any,
) -> dict[str, Any]:
    """Write and return what is to be known of a policy, as it stands in the file."""
    words = provenance(command) | {
        "seed": seed,
        "configs": [{"kind": type(config).__name__} | asdict(config) for config in configs],
        "curve": curve,
        "score": score,
    }
    words = plain(words | further)
    write_json(path, words)
    return words


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the policies asked for: those of distributions one by one on all cores, the others side by side."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+", choices=[*SCENARIOS, *DISTRIBUTIONS])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=archive.PRETRAINED)
    asked = parser.parse_args(arguments)

    def told(name: str) -> tuple[str, int, Path, str]:
        return name, asked.seed, asked.out, f"python -m experiments.recipes.pretraining {name} --seed {asked.seed}"

    with progress_bar() as bar:
        work = bar.add_task("policies", total=len(asked.names), note="")

        def watch(point: Point) -> None:
            success, steps = point["success_rate"], point["steps"]
            bar.console.print(f"after {point['wall_time_s']:.0f} s: {success:.1%} succeed, in {steps:.1f} steps")

        general = (generalist(*told(name), watch=watch) for name in asked.names if name in DISTRIBUTIONS)
        calls = [joblib.delayed(specialist)(*told(name)) for name in asked.names if name in SCENARIOS]
        special = joblib.Parallel(n_jobs=-1, return_as="generator_unordered")(calls)
        for made in itertools.chain(general, special):
            score = made["score"]
            bar.update(work, note=f"{score['scenario']}: {score['steps']:.4g} steps, gap {score['gap']:.1%}")
            bar.advance(work)


if __name__ == "__main__":
    main()
