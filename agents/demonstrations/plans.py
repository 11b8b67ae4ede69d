"""Planned demonstrations: optimal (K*) flights of a scenario, from displaced starts, or of sampled scenarios.

    flights = plan("random-goal", 1000, store=flights_folder())
    dataset = record("random-goal", flights)

For a scenario, the first flight begins at its start, the others at rest at displaced starts. For a distribution,
flight i belongs to seed + i. Each flight can also be perturbed and replanned (`agents.demonstrations.perturbed`). Each
random number depends on the seed and its index only. Neither the number of workers nor an interruption changes the
result.
"""

from __future__ import annotations

import math
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
from flatgym.scenarios.scenario import BOUNDS_MARGIN, Scenario
from flatgym.task.rollout import replay_to_goal
from flatgym.validation import nonnegative, whole
from optimal.batch import fewest_steps_many
from optimal.discrete.fewest_steps import TIME_BUDGET, FewestSteps
from optimal.flights.solution import SolveFailed

START_SPREAD = 0.5
"""Default of the largest distance of displaced starts from the scenario's start [m]."""
MAX_EPISODES = 10**7
"""Largest number of flights of a plan."""
MAX_SEED = 2**63 - 1
"""Largest seed of an environment; flight i has the seed of the plan plus i."""
ATTEMPTS = 10
"""Starts sampled per wanted flight before planning fails."""


def flights_folder() -> Path:
    """Return the cache folder of planned flights, beside Minari's datasets; it may be deleted at any time."""
    return staging_folder() / f"flights-{__version__}"


def plan(
    problem: ProblemLike,
    episodes: int,
    seed: int = 0,
    *,
    spread: float | None = None,
    own_start: bool = True,
    perturbed: int = 0,
    time_budget: float = 0.0,
    jobs: int = -1,
    backend: str = "loky",
    store: str | Path | None = None,
    progress: Progress = no_progress,
) -> list[Demonstration]:
    """Return flights in the fewest steps found: `episodes` from rest, then `perturbed` replanned copies of each.

    A sampled start without a flight is replaced by another. The scenario's own start must have a flight. A perturbation
    without a plan is replaced by others, and left out after several attempts.

    Args:
        problem: a scenario or a distribution.
        episodes: flights from rest.
        seed: seed of starts and perturbations.
        spread: largest distance of a displaced start from the scenario's own [m], at most BOUNDS_MARGIN. The default
            is START_SPREAD for a scenario and 0 for a distribution.
        own_start: whether the first flight of a scenario begins at its own start; not when a dataset is extended that
            holds this flight.
        perturbed: perturbed and replanned copies of each flight.
        time_budget: time for each proof that fewer steps are impossible [s]; at least TIME_BUDGET for the flight from
            a scenario's own start.
        jobs, backend, store: as in `optimal.fewest_steps_many`; with a store an interrupted run resumes.
        progress: called with the numbers of flights found and wanted.

    Raises:
        SolveFailed: if no flight is found for the scenario, or for too many sampled starts.
        ValueError: for wrong arguments, naming them.
        OSError: if a flight cannot be stored.
    """
    target = problem_named(problem)
    whole("episodes", episodes, 1, MAX_EPISODES)
    whole("perturbed", perturbed, 0, MAX_EPISODES)
    whole("seed", seed, 0, MAX_SEED - (ATTEMPTS + 1) * episodes)
    spread = _checked_spread(target, episodes - own_start, spread)
    workers: dict[str, Any] = {"jobs": jobs, "backend": backend, "store": store}
    wanted = episodes * (1 + perturbed)
    flights = _flights_from_rest(
        target, episodes, seed, spread, own_start, time_budget, workers, progress=lambda done, _: progress(done, wanted)
    )
    if perturbed:
        flights += perturb(
            flights, perturbed, seed, **workers, progress=lambda done, _: progress(episodes + done, wanted)
        )
    return flights


def _checked_spread(target: Problem, displaced_starts: int, spread: float | None) -> float:
    fixed = isinstance(target, Scenario)
    if spread is None:
        return START_SPREAD if fixed else 0.0
    spread = nonnegative("plan", "spread", spread)
    if fixed and displaced_starts and not spread:
        raise ValueError(f"with spread=0 all flights of {target.name!r} are equal; use one flight, or a larger spread")
    if spread > BOUNDS_MARGIN:
        raise ValueError(
            f"spread must be at most {BOUNDS_MARGIN:g} m, got {spread:g}: starts further away can be out of the bounds "
            f"of {target.name!r}, where an episode ends"
        )
    return spread


def _flights_from_rest(
    target: Problem,
    episodes: int,
    seed: int,
    spread: float,
    own_start: bool,
    time_budget: float,
    workers: dict[str, Any],
    progress: Progress,
) -> list[Demonstration]:
    """Return `episodes` flights from rest, in the order in which their starts are sampled."""
    flights: list[Demonstration] = []
    if isinstance(target, Scenario) and own_start:
        flights.append(_own_flight(target, seed, time_budget, workers))
        progress(1, episodes)
    sampled = len(flights)
    while len(flights) < episodes:
        numbers = range(sampled, sampled + episodes - len(flights))
        scenarios = [target if isinstance(target, Scenario) else target.scenario(seed + i) for i in numbers]
        starts = [
            displaced(scenario, np.random.default_rng((seed, i)), spread) if spread else scenario
            for i, scenario in zip(numbers, scenarios, strict=True)
        ]
        before, count = len(flights), len(starts)

        def advance(done: int, left: int, before: int = before, count: int = count) -> None:
            progress(before + count - left + done, episodes)

        answers = fewest_steps_many(starts, **workers, progress=advance, time_budget=time_budget)
        flights += [
            Demonstration(scenario, answer, seed + i)
            for i, scenario, answer in zip(numbers, scenarios, answers, strict=True)
            if _flies(scenario, answer)
        ]
        progress(len(flights), episodes)
        sampled = numbers.stop
        if sampled > ATTEMPTS * episodes:
            raise SolveFailed(starts[-1], answers[-1])
    return flights


def _flies(scenario: Scenario, flight: FewestSteps) -> bool:
    """Return whether a flight from a displaced start reaches the goal within the scenario's own bounds and time."""
    if not len(flight.actions):
        return False
    flown = replay_to_goal(scenario, flight.actions, flight.states[0])
    return flown is not None and len(flown) == len(flight.actions) + 1


def _own_flight(target: Scenario, seed: int, time_budget: float, workers: dict[str, Any]) -> Demonstration:
    """Return the flight from the scenario's own start; a SolveFailed if there is none."""
    budget = max(time_budget, TIME_BUDGET)
    (answer,) = fewest_steps_many([target], **workers | {"jobs": 1}, progress=False, time_budget=budget)
    if not len(answer.actions):
        raise SolveFailed(target, answer)
    return Demonstration(target, answer, seed)


def displaced(target: Scenario, generator: np.random.Generator, spread: float = START_SPREAD) -> Scenario:
    """Return the scenario with its start displaced by up to `spread` [m], between floor and ceiling, off the goal."""
    low, high = target.heights
    while True:
        radius, angle = spread * np.sqrt(generator.random()), generator.uniform(0, 2 * np.pi)
        x, z = target.start[0] + radius * np.cos(angle), target.start[1] + radius * np.sin(angle)
        start = (float(x), float(np.clip(z, low, high)))
        if target.hoops or math.dist(start, target.goal) > target.tolerance.position:
            return replace(target, start=start)
