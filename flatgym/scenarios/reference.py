"""What is known of the named scenarios: K*, T*, their proven bounds, and a flight in K* steps.

    table = reference("hoop")
    table.k_star, table.proven, table.time, table.time_lower_bound
    ghost_states("hoop")    # the K*-flight, to fly against
    drawn_k_star("random-goal", seeds).k_star    # of the scenarios that scores are flown on

The numbers stand in `reference.json` beside this file, so that a score needs no solver; `python -m
experiments.measurements.reference_table` computes them. They belong to the very scenarios of SCENARIOS and DISTRIBUTIONS:
whoever changes so much as a tolerance has to ask `optimal`.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Array
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import SCENARIOS, ProblemLike
from flatgym.scenarios.distributions import DISTRIBUTIONS
from flatgym.scenarios.scenario import Scenario

SCHEMA = 2
"""Version of `reference.json`; another is refused."""
FILE = "reference.json"
EVALUATION_SEED = 1_000_000
"""Seed of the first drawn scenario that scores are flown on; training keeps to smaller ones."""


@dataclass(frozen=True, eq=False)
class Reference:
    """What is known of one named scenario.

    Attributes:
        scenario: its name.
        k_star: K*, the fewest environment steps in which a flight is known.
        k_lower_bound: no flight whatever takes fewer steps.
        proven: whether the two agree.
        time: T*, the fastest flight known in continuous time, exactly rest to rest [s].
        time_lower_bound: no such flight is faster [s].
        winding: whole turns of the K*-flight.
        actions: the K*-flight as the environment's actions, float32, read-only, shape (K*, 2).
    """

    scenario: str
    k_star: int
    k_lower_bound: int
    proven: bool
    time: float
    time_lower_bound: float
    winding: int
    actions: NDArray[np.float32]

    @classmethod
    def of(cls, row: dict[str, Any]) -> Reference:
        """Return a row of the file as a value."""
        actions = np.array(row["actions"], dtype=np.float32)
        actions.setflags(write=False)
        return cls(
            scenario=row["scenario"],
            k_star=row["k_star"],
            k_lower_bound=row["k_lower_bound"],
            proven=row["proven"],
            time=row["time_s"],
            time_lower_bound=row["time_lower_bound_s"],
            winding=row["winding"],
            actions=actions,
        )

    def gap(self, steps: float) -> float:
        """Return how many more steps than K* a flight took, relatively."""
        return steps / self.k_star - 1


def reference(problem: ProblemLike) -> Reference | None:
    """Return what is known of a scenario, or None where it is not exactly one of SCENARIOS.

    Raises:
        ValueError: for an unknown name, listing the known ones.
    """
    found = catalogue.problem(problem)
    named = SCENARIOS.get(found.name)
    # Mostly it is the very same; to compare all fields would take longer than a step of one flight.
    if named is None or (named is not found and named != found):
        return None
    return _table().get(found.name)


def ghost_states(problem: ProblemLike) -> Array:
    """Return the states of the flight in K* steps, from start to goal, read-only, shape (K*+1, 5).

    Raises:
        ValueError: where no flight is stored.
    """
    found = reference(problem)
    if found is None:
        raise ValueError(
            f"no flight in K* steps is stored for {catalogue.problem(problem).name!r}, only for the scenarios of "
            f"flatgym.SCENARIOS as they are; give states of shape (K+1, 5) instead, as "
            f"optimal.fewest_steps(scenario).states has them"
        )
    return _flown(found.scenario)


class Drawn(NamedTuple):
    """What is known of drawn scenarios; NaN where nothing is.

    Attributes:
        k_star: the fewest environment steps in which a flight is known, shape (n,).
        k_lower_bound: no flight whatever takes fewer steps, shape (n,).
    """

    k_star: Array
    k_lower_bound: Array

    @property
    def proven(self) -> NDArray[np.bool_]:
        """Whether the two are known and agree, shape (n,)."""
        return np.equal(self.k_star, self.k_lower_bound)


def drawn_k_star(problem: ProblemLike, seeds: ArrayLike) -> Drawn:
    """Return what is known of the scenarios `distribution.scenario(seed)`.

    Args:
        problem: a distribution or its name; nothing is known but of those of DISTRIBUTIONS as they are.
        seeds: whole numbers, shape (n,); known from EVALUATION_SEED on.
    """
    found, seeds = catalogue.problem(problem), np.asarray(seeds)
    known = np.full((2, len(seeds)), np.nan)
    if found.name in _data()["draws"] and DISTRIBUTIONS.get(found.name) == found:
        first, rows = _draws(found.name)
        index = seeds.astype(np.int64) - first
        there = (index >= 0) & (index < rows.shape[1])
        known[:, there] = rows[:, index[there]]
    return Drawn(*known)


def k_star_of(problem: ProblemLike, seeds: ArrayLike) -> Array:
    """Return K* of the first episodes of n seeds, shape (n,); NaN where none is known.

    Args:
        problem: a scenario or distribution, or its name.
        seeds: whole numbers, shape (n,); of a scenario all have the same.
    """
    found, seeds = catalogue.problem(problem), np.asarray(seeds)
    if not isinstance(found, Scenario):
        return drawn_k_star(found, seeds).k_star
    known = reference(found)
    return np.full(len(seeds), float(known.k_star) if known else np.nan)


@lru_cache
def _flown(name: str) -> Array:
    scenario = SCENARIOS[name]
    states = [scenario.start_state]
    for control in scenario.quadrotor.control(_table()[name].actions):
        states.append(scenario.quadrotor.step(states[-1], control, scenario.dt))
    flown = np.array(states)
    flown.setflags(write=False)
    return flown


@lru_cache
def _draws(name: str) -> tuple[int, Array]:
    """Return the first seed of a distribution's known draws, and their K* and its lower bound, shape (2, n)."""
    row = _data()["draws"][name]
    return row["first_seed"], np.array([row["k_star"], row["k_lower_bound"]], dtype=np.float64)


@lru_cache
def _table() -> dict[str, Reference]:
    """Return all rows by the scenario's name."""
    return {row["scenario"]: Reference.of(row) for row in _data()["references"]}


@lru_cache
def _data() -> dict[str, Any]:
    """Return what the file holds; read once."""
    data: dict[str, Any] = json.loads(files("flatgym.scenarios").joinpath(FILE).read_text(encoding="utf-8"))
    if data.get("schema") != SCHEMA:
        raise ValueError(f"flatgym/scenarios/{FILE} has schema {data.get('schema')!r}, this version reads {SCHEMA}")
    return data
