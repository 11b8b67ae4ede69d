"""Training of the policies that come with the package; `flatquad pretrain hoop climb` runs it.

On a scenario, DAgger imitates an LQR around the optimal flight with margins (`experiments.recipes.margins`). Starts and
actions are perturbed widely at first, then closely. Training ends when the policy reaches the steps of that flight or
the rounds are over. On tracks the actor is categorical (`experiments.recipes.imitation.bins_of`).

On a distribution, DAgger starts from optimal flights of sampled scenarios. Three experts label the policy's episodes:
LQRs around these flights, new optimal plans after the last hoop, and the PD controller after a missed hoop.

On a distribution without a configuration of DAgger, `random-track` among them, PPO trains by reward alone: the
thousands of optimal flights that DAgger needs would take hours to plan.

Each policy has a card: its configuration, seed, command, versions, training time and score.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import joblib

from agents import policies
from agents.evaluation.protocol import protocol_episodes
from agents.evaluation.scores import evaluate
from agents.evaluation.validation import Point, milestones
from agents.imitation.cloning import untrained_policy
from agents.imitation.dataset_aggregation import DaggerConfig, dagger
from agents.imitation.oracles import combined_oracle, lqr_oracle
from agents.imitation.selection import BestPolicy
from agents.policies.compact import rounded
from agents.training.configs import PPOConfig
from agents.training.threads import torch_threads
from agents.training.train import train
from experiments.files import USER_RESULTS, cache_folder, plain, write_json
from experiments.provenance import provenance
from experiments.recipes.imitation import DISTRIBUTION_NETWORK, bins_of
from experiments.recipes.margins import HOOP_SHARE, robust_flight
from experiments.recipes.reinforcement import ppo_config
from experiments.recipes.run_spec import RunSpec
from flatgym import DISTRIBUTIONS, Distribution, Scenario
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import Problem, ProblemLike
from optimal.batch import fewest_steps_many
from optimal.parallel import parallel_results

STAGES = (
    (DaggerConfig(gradient_steps=1500, rounds=24, max_seconds=7200.0), 0.05),
    (DaggerConfig(gradient_steps=2000, rounds=60, learning_rate=1e-3, max_seconds=7200.0), 0.02),
)
"""Both stages of a scenario: configuration, and the `start_noise` and `action_noise` of `lqr_oracle`.

The second stage runs only if the first does not reach the steps of the expert. The rounds end it, not the time: a slow
machine trains the same policy.
"""
RANDOM_GOAL = DaggerConfig(
    **DISTRIBUTION_NETWORK, gradient_steps=3500, rounds=8, max_seconds=3600.0, n_eval_episodes=300
)
THROUGH_HOOPS = replace(RANDOM_GOAL, width=256, rounds=16)
DISTRIBUTION_CONFIGS = {"random-goal": RANDOM_GOAL, "random-hoops": THROUGH_HOOPS}
"""Configurations of DAgger on distributions."""
N_FLIGHTS = {"random-goal": 2600, "random-hoops": 3000}
"""Numbers of optimal flights to start from."""
STORE = USER_RESULTS / "flights"
"""Folder of the optimal flights of sampled scenarios."""
TRAININGS = USER_RESULTS / "pretraining"
"""Folder of the trainings by reward; an interrupted one resumes."""
Card = dict[str, Any]


def pretrain(
    tasks: Sequence[ProblemLike], seed: int, out: Path, watch: Callable[[Point], Any] = lambda _: None
) -> Iterator[Card]:
    """Train the policies of scenarios and distributions, write them, and yield their cards when done.

    Distributions are trained one by one, by DAgger on all cores; then scenarios, one on each core.

    Args:
        tasks: scenarios and distributions, one's own too.
        seed: of all trainings.
        out: folder of policies and cards, which bear the labels of the tasks.
        watch: receives each validation point of a distribution's training.

    Raises:
        ValueError: for an unknown task, before any training.
    """

    def arguments(task: Problem) -> tuple[str, int, Path, str]:
        return catalogue.text(task), seed, out, f"flatquad pretrain {catalogue.label(task)} --seed {seed}"

    problems = [catalogue.problem(task) for task in tasks]
    return _trained(problems, arguments, watch)


def _trained(
    problems: Sequence[Problem],
    arguments: Callable[[Problem], tuple[str, int, Path, str]],
    watch: Callable[[Point], Any],
) -> Iterator[Card]:
    for problem in problems:
        if isinstance(problem, Distribution):
            imitates = catalogue.label(problem) in DISTRIBUTION_CONFIGS
            yield (pretrain_distribution if imitates else pretrain_by_reward)(*arguments(problem), watch=watch)
    calls = [joblib.delayed(pretrain_scenario)(*arguments(task)) for task in problems if isinstance(task, Scenario)]
    yield from parallel_results(calls, -1, "generator_unordered")


def stages_of(scenario: Scenario, name: str, seed: int) -> list[tuple[DaggerConfig, float]]:
    """Return both stages of a scenario, by its name or JSON text: configuration, and spread of starts and actions."""
    bins = bins_of(scenario)
    return [(replace(config, scenario=name, seed=seed, bins=bins), spread) for config, spread in STAGES]


@torch_threads()
def pretrain_scenario(name: str, seed: int, out: Path, command: str) -> Card:
    """Train a policy for one scenario, by its name or JSON text, write it and its card, and return the card."""
    began, scenario = time.perf_counter(), catalogue.scenario(name)
    label, stages = catalogue.label(scenario), stages_of(scenario, name, seed)
    flight = robust_flight(scenario)
    best = BestPolicy(stages[0][0], target=flight.steps)
    model = untrained_policy(stages[0][0])
    for config, spread in stages:
        if not best.target_reached:
            oracle = lqr_oracle([flight], start_noise=spread, action_noise=spread, seed=seed)
            model = dagger(model, oracle, config, best)
    training_s = time.perf_counter() - began
    policies.save(model, out / f"{label}.zip", name)
    score = score_row(model, name, 1, "DAgger", best.env_steps, training_s, command)
    return write_card(out / f"{label}.json", seed, command, [config for config, _ in stages], best.curve, score)


def pretrain_distribution(
    name: str, seed: int, out: Path, command: str, jobs: int = -1, watch: Callable[[Point], Any] = lambda _: None
) -> Card:
    """Train a policy for a distribution, write it and its card, and return the card; arguments as of `pretrain`."""
    began, distribution = time.perf_counter(), DISTRIBUTIONS[name]
    config = replace(DISTRIBUTION_CONFIGS[name], scenario=name, seed=seed)
    scenarios = [distribution.scenario(i).narrowed(HOOP_SHARE) for i in range(N_FLIGHTS[name])]
    stored = len(list(STORE.glob(f"{name}-*.json")))
    flights = fewest_steps_many(scenarios, jobs=jobs, store=STORE)
    planned = time.perf_counter()
    best = BestPolicy(config, on_validation=watch)
    oracle = combined_oracle(flights, distribution, seed=seed, jobs=jobs)
    with torch_threads(joblib.effective_n_jobs(jobs)):
        model = dagger(untrained_policy(config), oracle, config, best)
    training_s = time.perf_counter() - began
    policies.save(rounded(model), out / f"{name}.zip", name)
    score = score_row(model, name, protocol_episodes(name), "DAgger", best.env_steps, training_s, command)
    cost = {"planning_s": round(planned - began, 1), "flights": len(flights), "planned_before": stored}
    return write_card(out / f"{name}.json", seed, command, [config], best.curve, score, **cost)


def pretrain_by_reward(
    name: str, seed: int, out: Path, command: str, watch: Callable[[Point], Any] = lambda _: None
) -> Card:
    """Train PPO on a distribution, by its name or JSON text, write the policy and its card, and return the card."""
    spec = RunSpec(name, seed, TRAININGS)
    config = ppo_config(spec)
    done = train(config, resume=True, on_validation=watch)
    model = rounded(policies.load(done.model, trust=True))
    policies.save(model, out / f"{spec.label}.zip", name)
    score = score_row(model, name, protocol_episodes(name), "PPO", done.env_steps, done.wall_time_s, command)
    curve = milestones(done.curve, success=1.0)  # of hundreds of validations
    return write_card(out / f"{spec.label}.json", seed, command, [without_folder(config)], curve, score)


def without_folder(config: PPOConfig) -> PPOConfig:
    """Return a configuration with the default folder: a card tells nothing about the machine's folders."""
    return replace(config, folder=PPOConfig.folder)


def score_row(
    model: Any, name: str, episodes: int, algorithm: str, env_steps: int, training_s: float, command: str
) -> Card:
    """Return the score row of a trained policy."""
    rows = evaluate(
        model,
        name,
        episodes,
        agent=catalogue.label(name),
        algorithm=algorithm,
        env_steps=env_steps,
        wall_time_s=round(training_s, 1),
        command=command,
        store=cache_folder(),
    )
    return dict(rows.iloc[0])


def write_card(
    path: Path, seed: int, command: str, configs: Sequence[Any], curve: list[Point], score: Card, **further: Any
) -> Card:
    """Write the card of a policy, and return it as the file holds it."""
    card = provenance(command) | {
        "seed": seed,
        "configs": [{"kind": type(config).__name__} | asdict(config) for config in configs],
        "curve": curve,
        "score": score,
    }
    card = plain(card | further)
    write_json(path, card)
    return card
