"""Perturbed demonstrations: flights perturbed at a random step and replanned from there to the goal.

A policy that leaves the demonstrated path needs demonstrations of recovery. The state at a random step is perturbed by
normal noise, and the fewest steps from there are searched near the remainder of the flight
(`optimal.discrete.replanning`). Only flights whose replay in the environment ends in the outcome "goal" are returned.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from agents.demonstrations.recording import Demonstration, Progress, no_progress
from flatgym.quadrotor import Array
from flatgym.task.rollout import episode_outcomes, replay_to_goal
from optimal.discrete.fewest_steps import FewestSteps
from optimal.discrete.replanning import RemainingTask, remaining_trajectory, replan
from optimal.flights.solution import Status
from optimal.parallel import unordered
from optimal.store import Store

PERTURBATION_STD = np.array([0.2, 0.2, 0.5, 0.5, 0.2])
"""Standard deviations of the perturbation [m, m, m/s, m/s, rad]."""
ATTEMPTS = 5
"""Perturbations tried for each flight until a plan is found."""

Key: TypeAlias = tuple[int, int]
"""Index of a flight, and index of its perturbed copy."""


@dataclass(frozen=True, eq=False)
class Perturbed:
    """A perturbed state of a flight.

    Attributes:
        flight: the flight.
        step: step of the perturbation.
        state: the perturbed state, shape (5,).
        hoops_passed: hoops passed before it.
    """

    flight: Demonstration
    step: int
    state: Array
    hoops_passed: int

    def stored(self, folder: str | Path) -> Store:
        """Return the store entry in a folder for the flight replanned from here."""
        flown = {"start": self.flight.flight.states[0].tolist(), "steps": self.flight.steps, "step": self.step}
        return Store(folder, {"ask": "replan", "state": self.state.tolist(), "passed": self.hoops_passed} | flown)


def perturb(
    flights: Sequence[Demonstration],
    times: int,
    seed: int,
    *,
    jobs: int = -1,
    backend: str = "loky",
    store: str | Path | None = None,
    progress: Progress = no_progress,
) -> list[Demonstration]:
    """Return `times` replanned copies of each flight, in order; fewer if ATTEMPTS perturbations give no plan.

    Args:
        flights: flights from rest.
        times: copies of each flight.
        seed: seed of the perturbations. Each depends on the seed and its indices only.
        jobs, backend, store: as in `optimal.fewest_steps_many`.
        progress: called with the numbers of flights found and wanted.
    """
    passed = [_hoops_passed(flight) for flight in flights]
    left = [(i, j) for i in range(len(flights)) for j in range(times)]
    found: dict[Key, Demonstration] = {}
    for attempt in range(ATTEMPTS):
        tasks = {
            (i, j): random_perturbation(flights[i], passed[i], np.random.default_rng((seed, i, j, attempt)))
            for i, j in left
        }
        for key, answer in _replanned_flights(tasks, jobs, backend, store):
            if len(answer.actions):
                one = tasks[key]
                found[key] = Demonstration(one.flight.scenario, answer, one.flight.seed, one.hoops_passed)
                progress(len(found), len(flights) * times)
        left = [key for key in left if key not in found]
    return [found[key] for key in sorted(found)]


def random_perturbation(flight: Demonstration, passed: Sequence[int], generator: np.random.Generator) -> Perturbed:
    """Return a perturbation at a random step, clipped to floor and ceiling.

    Args:
        flight: the flight.
        passed: hoops passed before each of its steps, shape (K+1,).
        generator: samples step and perturbation.
    """
    step = int(generator.integers(flight.steps))
    state = flight.flight.states[step] + PERTURBATION_STD * generator.normal(size=5)
    low, high = flight.scenario.heights
    state[1] = np.clip(state[1], low, high)
    return Perturbed(flight, step, state, passed[step])


def replanned(start: Perturbed) -> FewestSteps:
    """Return the fewest steps found from a perturbed state; the result has no flight if none is found.

    The lower bound is 0, because none is known for starts in motion.
    """
    target, before = start.flight.scenario, start.flight.flight
    try:
        left = RemainingTask.of(target, start.state, start.hoops_passed)
        found = replan(left, remaining_trajectory(before, start.step, target), before.winding)
    except Exception as error:
        return FewestSteps.failed(target, Status.INTERRUPTED, f"{type(error).__name__}: {error}")
    flown = None if found is None else replay_to_goal(target, found.actions, start.state, start.hoops_passed)
    if found is None or flown is None or len(flown) != len(found.actions) + 1:
        return FewestSteps.failed(target, Status.NO_STEPS_FOUND)
    return FewestSteps(target, len(found.actions), *found, 0, Status.BEST_KNOWN)


def _hoops_passed(flight: Demonstration) -> list[int]:
    """Return the hoops that a flight from rest has passed at each of its points, K+1 numbers from 0."""
    flown = flight.flight
    return [0, *episode_outcomes(flown.scenario, flown.states, flown.actions).hoops_passed.tolist()]


def _replanned_flights(
    tasks: dict[Key, Perturbed], jobs: int, backend: str, store: str | Path | None
) -> Iterator[tuple[Key, FewestSteps]]:
    """Yield the replanned flights: stored ones first, then the others in order of completion, storing them."""
    left = []
    for key, start in tasks.items():
        cached = None if store is None else start.stored(store).read(start.flight.scenario)
        if isinstance(cached, FewestSteps):
            yield key, cached
        else:
            left.append((key, start))
    left.sort(key=lambda task: _program_key(task[1]))
    for key, answer in unordered(_solve, left, jobs, backend) if left else ():  # type: ignore[arg-type]
        if store is not None and answer.status is not Status.INTERRUPTED:
            tasks[key].stored(store).write(answer)
        yield key, answer


def _program_key(start: Perturbed) -> tuple[int, int]:
    """Return the hoops and steps left, by which tasks with similar programs are grouped."""
    return len(start.flight.scenario.hoops) - start.hoops_passed, start.flight.steps - start.step


def _solve(task: tuple[Key, Perturbed]) -> tuple[Key, FewestSteps]:
    return task[0], replanned(task[1])
