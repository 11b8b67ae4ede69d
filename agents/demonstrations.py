"""Demonstrations: fewest-steps flights, recorded through the real environment as a Minari dataset.

The first episode is the scenario itself; the others begin at rest a little away from its start,
each with a flight of its own. What is stored is what the environment said while the planned
actions were flown, and only flights that end in the outcome "goal" are stored.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from typing import Any

import gymnasium as gym
import minari
import numpy as np

from flatgym import __version__
from flatgym.catalogue import SCENARIOS, ScenarioLike, scenario
from flatgym.scenario import Scenario
from optimal.solution import SolveFailed
from optimal.steps import FewestSteps, fewest_steps

START_SPREAD = 0.5
"""Largest distance of a displaced start from the scenario's own [m]."""


def dataset_id(problem: ScenarioLike) -> str:
    """Return the Minari name of a scenario's demonstrations."""
    return f"flatquad/{scenario(problem).name}/optimal-v0"


def displaced(target: Scenario, generator: np.random.Generator) -> Scenario:
    """Return the scenario with its start moved by up to START_SPREAD, between floor and ceiling."""
    radius, angle = START_SPREAD * np.sqrt(generator.random()), generator.uniform(0, 2 * np.pi)
    low = -np.inf if target.floor is None else target.floor
    high = np.inf if target.ceiling is None else target.ceiling
    x, z = target.start[0] + radius * np.cos(angle), target.start[1] + radius * np.sin(angle)
    return replace(target, start=(float(x), float(np.clip(z, low, high))))


def plan(
    problem: ScenarioLike, episodes: int, seed: int = 0, progress: Callable[[], Any] = lambda: None
) -> list[FewestSteps]:
    """Return fewest-steps flights: the scenario's own, then `episodes` - 1 from displaced starts.

    A displaced start for which no flight is found is drawn again; the scenario itself must be solved.
    """
    target, generator = scenario(problem), np.random.default_rng(seed)
    flights = [fewest_steps(target)]
    progress()
    while len(flights) < episodes:
        try:
            flights.append(fewest_steps(displaced(target, generator), windings=(flights[0].winding,), time_budget=0.0))
        except SolveFailed:
            continue
        progress()
    return flights


def record(problem: ScenarioLike, flights: list[FewestSteps], name: str | None = None) -> minari.MinariDataset:
    """Fly the actions in the environment and store the episodes, replacing a dataset of that name.

    Args:
        problem: the scenario of the environment.
        flights: flights of this scenario, from its start or from others.
        name: Minari's dataset id; by default `dataset_id(problem)`.

    Raises:
        RuntimeError: when a flight does not end in the outcome "goal" at its K-th step.
    """
    target, name = scenario(problem), name or dataset_id(problem)
    plain = target.name if SCENARIOS.get(target.name) == target else target.to_json()
    real = gym.make("FlatQuad-v0", scenario=plain, reward="sparse")
    env = minari.DataCollector(real)
    for flight in flights:
        env.reset(seed=0, options={"state": flight.scenario.start_state})
        for action in flight.actions:
            info = env.step(action)[4]
        if info["outcome"] != "goal" or info["steps"] != flight.steps:
            raise RuntimeError(f"{target.name!r}: a planned flight of {flight.steps} steps ended as {info}")
    if name in minari.list_local_datasets():
        with redirect_stdout(io.StringIO()):  # Minari would print where tables and JSON go
            minari.delete_dataset(name)
    best = -flights[0].steps * target.dt
    dataset = env.create_dataset(
        dataset_id=name,
        eval_env=real.spec,
        algorithm_name="optimal.fewest_steps",
        author="FlatQuad",
        author_email="",
        code_permalink="",
        description=f"Fewest-steps flights of {target.name!r}, flatgym {__version__}; reward: minus time.",
        ref_min_score=-target.time_limit,
        ref_max_score=best,
    )
    env.close()
    return dataset
