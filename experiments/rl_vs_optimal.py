"""The benchmark: solve, demonstrate, train, score - how far from optimal does an agent fly?

    scenario -> optimum (T*, K*) -> demonstrations -> PPO -> score -> benchmark.json, CSV, figures

Everything in the results comes from this run: nothing is typed, nothing carried over.
"""

from __future__ import annotations

import platform
import threading
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pandas as pd
from rich.progress import Progress

import optimal
from agents import demonstrations
from agents.configs import PPOConfig
from agents.evaluate import Policy, evaluate, fly, versions
from agents.train import Training, load, read_curve, train
from experiments import figures
from experiments.files import SCHEMA, write_json
from flatgym import OUTCOMES
from flatgym.scenario import Scenario
from flatgym.task import fly_actions
from optimal import FewestSteps, Solution
from optimal.export import write_text

SCENARIOS = ("horizontal-6", "hoop")
DEMONSTRATIONS = 6
EPISODES = 10


def run(
    out: Path,
    *,
    scenarios: Sequence[str] = SCENARIOS,
    seconds: float,
    seed: int,
    command: str,
    bar: Progress,
) -> dict[str, Any]:
    """Run the whole benchmark and write its results to `out`.

    Args:
        out: folder for benchmark.json, scores.csv, the figures and the models.
        scenarios: names of the scenarios.
        seconds: wall time of each training [s].
        seed: of demonstrations and training.
        command: what the user typed, for the record.
        bar: shows how far the work is.

    Returns:
        What benchmark.json holds.
    """
    work = bar.add_task("solve and fly K*", total=len(scenarios), note="")
    solutions, flights = {}, {}
    for name in scenarios:
        solutions[name] = optimal.solve(name)
        bar.advance(work)
        flights[name] = _demonstrate(name, seed, bar)
    configs = [
        PPOConfig(scenario=name, seed=seed, seconds=seconds, folder=str(out / "models" / name)) for name in scenarios
    ]
    trainings = _train(configs, [flights[name][0] for name in scenarios], bar)
    results: dict[str, Any] = {
        "schema": SCHEMA,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": command,
        "versions": versions(),
        "machine": {"processor": platform.machine(), "system": platform.system(), "cores": joblib.cpu_count()},
        "solutions": [solution.row() for solution in solutions.values()],
        "demonstrations": {name: [flight.steps for flight in flown] for name, flown in flights.items()},
        "configs": [asdict(config) for config in configs],
        "curves": {training.config.scenario: training.curve for training in trainings},
        "flights": {},
        "scores": [],
    }
    work = bar.add_task("score", total=len(trainings), note="")
    for training in trainings:
        name = training.config.scenario
        policy = load(training.model)
        results["scores"].append(_score(policy, training, flights[name][0], command))
        results["flights"][name] = {
            "optimal": flights[name][0].actions.tolist(),
            "ppo": fly(policy, name).actions[0].tolist(),
        }
        draw(out, results, solutions[name])
        bar.advance(work)
    write_json(out / "benchmark.json", results)
    write_text(out / "scores.csv", pd.DataFrame(results["scores"]).to_csv(index=False))
    return results


def _demonstrate(name: str, seed: int, bar: Progress) -> list[FewestSteps]:
    """Find K* and flights from displaced starts, and store them as a Minari dataset."""
    work = bar.add_task(f"demonstrations of {name}", total=DEMONSTRATIONS, note="")
    planned = demonstrations.plan(
        name, DEMONSTRATIONS, seed, jobs=1, progress=lambda done, of: bar.update(work, completed=done, total=of)
    )
    dataset = demonstrations.record(name, planned)
    bar.update(work, note=f"K* = {planned[0].steps}, stored as {dataset.id}")
    return [one.flight for one in planned]


def _train(configs: Sequence[PPOConfig], optima: Sequence[FewestSteps], bar: Progress) -> list[Training]:
    """Train all configurations side by side, one core each, showing the newest point of each curve."""
    works = [bar.add_task(f"PPO on {config.scenario} [s]", total=round(config.seconds), note="") for config in configs]
    done = threading.Event()

    def watch() -> None:
        while not done.wait(0.5):
            for config, work in zip(configs, works, strict=True):
                curve = read_curve(config)
                if curve:
                    last = curve[-1]
                    note = f"{last['outcome']} after {last['steps']} steps"
                    bar.update(work, completed=min(round(last["wall_time_s"]), round(config.seconds)), note=note)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        jobs = (joblib.delayed(train)(config, optimum) for config, optimum in zip(configs, optima, strict=True))
        trainings: list[Training] = joblib.Parallel(n_jobs=min(len(configs), joblib.cpu_count()))(jobs)
    finally:
        done.set()
        watcher.join()
    for training, work in zip(trainings, works, strict=True):
        bar.update(work, completed=round(training.config.seconds), note=f"{training.env_steps:,} environment steps")
    return trainings


def _score(policy: Policy, training: Training, optimum: FewestSteps, command: str) -> dict[str, Any]:
    scores = evaluate(
        policy,
        training.config.scenario,
        EPISODES,
        training.config.seed,
        optimum=optimum,
        agent="ppo",
        algorithm="PPO",
        env_steps=training.env_steps,
        wall_time_s=round(training.wall_time_s, 1),
        command=command,
    )
    return dict(scores.iloc[0])


def draw(out: Path, results: dict[str, Any], solution: Solution) -> None:
    """Write the figures of one scenario: paths, controls, learning curve."""
    scenario, name = solution.scenario, solution.scenario.name
    tracks = [optimal_track(solution), agent_track(results, scenario)]
    k_star = len(results["flights"][name]["optimal"])
    for kind, figure in {
        "paths": figures.paths(scenario, tracks, f"{name}: the optimum and the agent"),
        "controls": figures.controls(scenario.quadrotor, tracks, f"{name}: controls"),
        "learning": figures.learning(results["curves"][name], k_star, f"{name}: PPO learning to fly"),
    }.items():
        figures.write(figure, out / f"{name}-{kind}.html")


def optimal_track(solution: Solution) -> figures.Track:
    """Return the certified flight of a solution, finely sampled, to draw."""
    assert solution.trajectory is not None
    samples = solution.trajectory.sample(0.002)
    return figures.Track(f"optimum, T* = {solution.time:.4f} s", samples.time, samples.state, samples.control)


def agent_track(results: dict[str, Any], scenario: Scenario) -> figures.Track:
    """Return the agent's flight, flown again from the actions in the results, to draw."""
    actions = np.array(results["flights"][scenario.name]["ppo"], dtype=np.float32)
    situations = fly_actions(scenario, actions)
    states = np.array([situation.state[0] for situation in situations])
    controls = scenario.quadrotor.control(np.append(actions, actions[-1:], axis=0))
    time = np.linspace(0.0, scenario.dt * len(actions), len(states))
    label = f"PPO, {len(actions)} steps: {OUTCOMES[situations[-1].outcome[0]]}"
    return figures.Track(label, time, states, controls)
