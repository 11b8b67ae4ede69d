"""Demonstrations: flights in the fewest steps, of a scenario and from starts around it, or of random scenarios.

    flights = plan("random-goal", 1000, store=flights_folder())
    dataset = record("random-goal", flights)

Of a scenario the first flight is its own and the others begin at rest a little away from its start; of a distribution
the i-th is that of seed + i. Each can also be knocked off on its way and planned anew (`agents.demonstrations.perturbed`). Every
draw is a function of the seed and of its number, so that neither the number of workers nor a run broken off changes
what is planned.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from agents.demonstrations.perturbed import perturb
from agents.demonstrations.recording import Demonstration, Progress, no_progress
from agents.demonstrations.storage import staging_folder
from flatgym import __version__
from flatgym.scenarios.catalogue import Problem, ProblemLike
from flatgym.scenarios.catalogue import problem as problem_named
from flatgym.scenarios.scenario import Scenario
from flatgym.validation import nonnegative, whole
from optimal.batch import fewest_steps_many
from optimal.discrete.fewest_steps import TIME_BUDGET
from optimal.flights.solution import SolveFailed

START_SPREAD = 0.5
"""Largest distance of the displaced starts of a scenario from its own, unless another is asked for [m]."""
EPISODES_MOST = 10**7
"""Most flights of a plan."""
SEED_MOST = 2**63 - 1
"""Greatest seed of an environment; flight i has that of the plan and i more."""
TRIES = 10
"""Starts drawn for each flight wanted, before it is given up."""


def flights_folder() -> Path:
    """Return where to keep flights that are found, beside Minari's datasets; it may be deleted at any time."""
    return staging_folder() / f"flights-{__version__}"


def plan(
    problem: ProblemLike,
    episodes: int,
    seed: int = 0,
    *,
    spread: float | None = None,
    perturbed: int = 0,
    time_budget: float = 0.0,
    jobs: int = -1,
    backend: str = "loky",
    store: str | Path | None = None,
    progress: Progress = no_progress,
) -> list[Demonstration]:
    """Return flights in the fewest steps found: `episodes` from rest, then `perturbed` continuations of each.

    A start from which no flight is found is drawn again, but a scenario's own must be flown. A continuation for which
    none is found is knocked off differently, and left out at last.

    Args:
        problem: a scenario, or a distribution of them.
        episodes: flights from rest.
        seed: of the draws.
        spread: largest distance of a start from the scenario's own [m]; by default START_SPREAD for a scenario, whose
            first flight begins at its own start, and 0 for a distribution.
        perturbed: how often each flight is knocked off on its way and planned anew.
        time_budget: time granted for each proof that fewer steps are impossible [s]; the flight from a scenario's own
            start is granted TIME_BUDGET at least.
        jobs, backend, store: as in `optimal.fewest_steps_many`; with a store a broken-off run goes on where it stopped.
        progress: called with how many flights there are and how many are wanted.

    Raises:
        SolveFailed: when a scenario, or too many of the starts drawn, cannot be flown.
        ValueError: for wrong arguments, naming them.
        OSError: when a flight cannot be kept in the store.
    """
    target = problem_named(problem)
    whole("episodes", episodes, 1, EPISODES_MOST)
    whole("perturbed", perturbed, 0, EPISODES_MOST)
    whole("seed", seed, 0, SEED_MOST - (TRIES + 1) * episodes)
    spread = _checked_spread(target, episodes, spread)
    workers: dict[str, Any] = {"jobs": jobs, "backend": backend, "store": store}
    wanted = episodes * (1 + perturbed)
    flights = _from_rest(
        target, episodes, seed, spread, time_budget, workers, progress=lambda done: progress(done, wanted)
    )
    if perturbed:
        flights += perturb(flights, perturbed, seed, **workers, progress=lambda done: progress(episodes + done, wanted))
    return flights


def _checked_spread(target: Problem, episodes: int, spread: float | None) -> float:
    fixed = isinstance(target, Scenario)
    if spread is None:
        return START_SPREAD if fixed else 0.0
    spread = nonnegative("plan", "spread", spread)
    if fixed and episodes > 1 and not spread:
        raise ValueError(f"with spread=0 all {episodes} flights of {target.name!r} would be the same; ask for 1")
    return spread


def _from_rest(
    target: Problem,
    episodes: int,
    seed: int,
    spread: float,
    time_budget: float,
    workers: dict[str, Any],
    progress: Callable[[int], Any],
) -> list[Demonstration]:
    """Return as many flights from rest, in the order in which their starts are drawn."""
    flights: list[Demonstration] = []
    if isinstance(target, Scenario):
        (answer,) = fewest_steps_many(
            [target], **workers | {"jobs": 1}, progress=False, time_budget=max(time_budget, TIME_BUDGET)
        )
        if not len(answer.actions):
            raise SolveFailed(target, answer)
        flights.append(Demonstration(target, answer, seed))
        progress(1)
    drawn = len(flights)
    while len(flights) < episodes:
        numbers = range(drawn, drawn + episodes - len(flights))
        flown = [target if isinstance(target, Scenario) else target.scenario(seed + i) for i in numbers]
        starts = [
            displaced(scenario, np.random.default_rng((seed, i)), spread) if spread else scenario
            for i, scenario in zip(numbers, flown, strict=True)
        ]
        before, count = len(flights), len(starts)

        def tell(done: int, left: int, before: int = before, count: int = count) -> None:
            progress(before + count - left + done)

        answers = fewest_steps_many(starts, **workers, progress=tell, time_budget=time_budget)
        flights += [
            Demonstration(scenario, answer, seed + i)
            for i, scenario, answer in zip(numbers, flown, answers, strict=True)
            if len(answer.actions)
        ]
        progress(len(flights))
        drawn = numbers.stop
        if drawn > TRIES * episodes:
            raise SolveFailed(starts[-1], answers[-1])
    return flights


def displaced(target: Scenario, generator: np.random.Generator, spread: float = START_SPREAD) -> Scenario:
    """Return the scenario with its start moved by up to `spread` [m], between floor and ceiling and not at the goal."""
    low, high = target.heights
    while True:
        radius, angle = spread * np.sqrt(generator.random()), generator.uniform(0, 2 * np.pi)
        x, z = target.start[0] + radius * np.cos(angle), target.start[1] + radius * np.sin(angle)
        start = (float(x), float(np.clip(z, low, high)))
        if target.hoops or math.dist(start, target.goal) > target.tolerance.position:
            return replace(target, start=start)
