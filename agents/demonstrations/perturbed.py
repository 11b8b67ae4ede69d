"""Continuations: flights knocked off on their way, and planned anew from there to the goal.

A learner that strays from the demonstrated path needs to see how one comes back. At a random step of a flight its
state is disturbed by normal deviates, and the fewest steps from there are found near the rest of the flight
(`optimal.discrete.replanning`). What is kept has been flown by the environment's own verbs to the outcome "goal".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from agents.demonstrations.recording import Demonstration, no_progress
from flatgym.quadrotor import Array
from flatgym.task.rollout import episode_outcomes, replay_to_goal
from optimal.discrete.fewest_steps import FewestSteps
from optimal.discrete.replanning import RemainingTask, remaining_trajectory, replan
from optimal.flights.solution import Status
from optimal.parallel import unordered
from optimal.store import Store

PERTURBATION_STD = np.array([0.2, 0.2, 0.5, 0.5, 0.2])
"""Standard deviations by which a state is disturbed [m, m, m/s, m/s, rad]."""
TRIES = 5
"""How often a flight is knocked off anew where no way to the goal is found."""

Key: TypeAlias = tuple[int, int]
"""The number of a flight, and that of its continuation."""


@dataclass(frozen=True, eq=False)
class Perturbed:
    """A flight that was knocked off.

    Attributes:
        flight: what it was until then.
        step: after so many of its steps.
        state: where it is now, shape (5,).
        hoops_passed: hoops passed by then.
    """

    flight: Demonstration
    step: int
    state: Array
    hoops_passed: int

    def stored(self, folder: str | Path) -> Store:
        """Return a store in a folder for the continuation of this flight."""
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
    progress: Callable[[int], Any] = no_progress,
) -> list[Demonstration]:
    """Return `times` continuations of each flight, in order; fewer where none is found in TRIES.

    Args:
        flights: flights from the beginning.
        times: continuations of each.
        seed: of the draws; each is a function of it and of its number.
        jobs, backend, store: as in `optimal.fewest_steps_many`.
        progress: called with how many there are.
    """
    passed = [_hoops_passed(flight) for flight in flights]
    left = [(i, j) for i in range(len(flights)) for j in range(times)]
    found: dict[Key, Demonstration] = {}
    for attempt in range(TRIES):
        tasks = {(i, j): knocked(flights[i], passed[i], np.random.default_rng((seed, i, j, attempt))) for i, j in left}
        for key, answer in _continued(tasks, jobs, backend, store):
            if len(answer.actions):
                one = tasks[key]
                found[key] = Demonstration(one.flight.scenario, answer, one.flight.seed, one.hoops_passed)
                progress(len(found))
        left = [key for key in left if key not in found]
    return [found[key] for key in sorted(found)]


def knocked(flight: Demonstration, passed: Sequence[int], generator: np.random.Generator) -> Perturbed:
    """Return a flight knocked off at a random step, between floor and ceiling.

    Args:
        flight: the flight.
        passed: hoops passed after each of its steps, shape (K,).
        generator: draws step and disturbance.
    """
    step = int(generator.integers(flight.steps))
    state = flight.flight.states[step] + PERTURBATION_STD * generator.normal(size=5)
    low, high = flight.scenario.heights
    state[1] = np.clip(state[1], low, high)
    return Perturbed(flight, step, state, passed[step])


def continuation(off: Perturbed) -> FewestSteps:
    """Return the fewest steps found from where a flight was knocked off; without a flight where none is found.

    No bound is known for flights that do not begin at rest, so lower_bound is 0.
    """
    target, before = off.flight.scenario, off.flight.flight
    try:
        left = RemainingTask.of(target, off.state, off.hoops_passed)
        found = replan(left, remaining_trajectory(before, off.step, target), before.winding)
    except Exception as error:
        return FewestSteps.failed(target, Status.INTERRUPTED, f"{type(error).__name__}: {error}")
    flown = None if found is None else replay_to_goal(target, found.actions, off.state, off.hoops_passed)
    if found is None or flown is None or len(flown) != len(found.actions) + 1:
        return FewestSteps.failed(target, Status.NO_STEPS_FOUND)
    return FewestSteps(target, len(found.actions), *found, 0, Status.BEST_KNOWN)


def _hoops_passed(flight: Demonstration) -> list[int]:
    """Return how many hoops a flight from rest has passed after each of its steps, from none on."""
    flown = flight.flight
    return [0, *episode_outcomes(flown.scenario, flown.states, flown.actions).hoops_passed.tolist()]


def _continued(
    tasks: dict[Key, Perturbed], jobs: int, backend: str, store: str | Path | None
) -> Iterator[tuple[Key, FewestSteps]]:
    """Yield the continuations, those in the store first, the others as they come and are kept."""
    left = []
    for key, off in tasks.items():
        kept = None if store is None else off.stored(store).read(off.flight.scenario)
        if isinstance(kept, FewestSteps):
            yield key, kept
        else:
            left.append((key, off))
    left.sort(key=lambda asked: _likeness(asked[1]))
    for key, answer in unordered(_keyed, left, jobs, backend) if left else ():  # type: ignore[arg-type]
        if store is not None and answer.status is not Status.INTERRUPTED:
            tasks[key].stored(store).write(answer)
        yield key, answer


def _likeness(off: Perturbed) -> tuple[int, int]:
    """Return what continuations of like programs have in common: hoops and steps left."""
    return len(off.flight.scenario.hoops) - off.hoops_passed, off.flight.steps - off.step


def _keyed(asked: tuple[Key, Perturbed]) -> tuple[Key, FewestSteps]:
    return asked[0], continuation(asked[1])
