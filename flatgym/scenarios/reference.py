"""Best-known solutions: K*, T*, their proven bounds, and a trajectory of K* steps.

    table = reference("hoop")
    table.k_star, table.proven, table.time, table.time_lower_bound
    ghost_states("hoop")    # states of the K*-step solution
    drawn_k_star("random-goal", seeds).k_star    # of the sampled scenarios used for evaluation

The numbers are stored in `reference.json` beside this file, so scores need no solver.
`flatquad measure reference` computes them. They hold for scenarios and distributions with the content of those of
SCENARIOS and DISTRIBUTIONS, whatever they are called. For any other scenario, even with another tolerance only, use the
package `optimal`.
"""

from __future__ import annotations

import hashlib
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
"""Version of `reference.json`; others are rejected."""
FILE = "reference.json"
EVALUATION_SEED = 1_000_000
"""First seed of the evaluation episodes; training uses seeds well below, or far above."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The best-known solution of one named scenario.

    Attributes:
        scenario: name of the scenario.
        k_star: K*, the fewest environment steps of any known solution.
        k_lower_bound: proven lower bound of the steps of any solution.
        proven: whether the two are equal.
        time: T*, the shortest known time of a continuous-time solution, exactly rest to rest [s].
        time_lower_bound: proven lower bound of that time [s].
        winding: whole turns of theta in the K*-step solution.
        actions: actions of the K*-step solution, float32, read-only, shape (K*, 2).
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
        """Return the solution stored in one row of the file."""
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

    def to_row(self) -> dict[str, Any]:
        """Return the solution as plain data, as `of` reads it; an unknown time is NaN."""
        return {
            "scenario": self.scenario,
            "k_star": self.k_star,
            "k_lower_bound": self.k_lower_bound,
            "proven": self.proven,
            "time_s": self.time,
            "time_lower_bound_s": self.time_lower_bound,
            "winding": self.winding,
            "actions": self.actions.tolist(),
        }

    def gap(self, steps: float) -> float:
        """Return steps / K* - 1."""
        return steps / self.k_star - 1


def reference(problem: ProblemLike) -> Reference | None:
    """Return the best-known solution of a scenario, or None if its content is not that of one of SCENARIOS.

    Raises:
        ValueError: for an unknown name, with the known names.
    """
    found = catalogue.problem(problem)
    return _by_digest().get(found.digest)


def ghost_states(problem: ProblemLike) -> Array:
    """Return the states of the K*-step solution, from start to goal, read-only, shape (K*+1, 5).

    Raises:
        ValueError: if no solution is stored for the scenario.
    """
    found = reference(problem)
    if found is None:
        raise ValueError(
            f"no K*-step solution is stored for {catalogue.problem(problem).name!r}, only for the scenarios of "
            f"flatgym.SCENARIOS as they are; give states of shape (K+1, 5) instead, as "
            f"optimal.fewest_steps(scenario).states has them"
        )
    return _states(found.scenario)


class Drawn(NamedTuple):
    """K* of sampled scenarios and its lower bound; NaN where unknown.

    Attributes:
        k_star: the fewest environment steps of any known solution, shape (n,).
        k_lower_bound: proven lower bound of the steps of any solution, shape (n,).
    """

    k_star: Array
    k_lower_bound: Array

    @property
    def proven(self) -> NDArray[np.bool_]:
        """Whether the two are known and equal, shape (n,)."""
        return np.equal(self.k_star, self.k_lower_bound)


def drawn_k_star(problem: ProblemLike, seeds: ArrayLike) -> Drawn:
    """Return K* of the scenarios `distribution.scenario(seed)`.

    Args:
        problem: a distribution or its name; K* is known for unchanged members of DISTRIBUTIONS only.
        seeds: integers, shape (n,); K* is known for seeds from EVALUATION_SEED on.
    """
    found, seeds = catalogue.problem(problem), np.asarray(seeds)
    known = np.full((2, len(seeds)), np.nan)
    name = _distributions().get(found.digest)
    if name in _data()["draws"]:
        first, rows = _draws(name)
        index = seeds.astype(np.int64) - first
        there = (index >= 0) & (index < rows.shape[1])
        known[:, there] = rows[:, index[there]]
    return Drawn(*known)


def k_star_of(problem: ProblemLike, seeds: ArrayLike) -> Array:
    """Return K* of the first episodes of n seeds, shape (n,); NaN where unknown.

    Args:
        problem: a scenario or distribution, or its name.
        seeds: integers, shape (n,); for a scenario, K* does not depend on them.
    """
    found, seeds = catalogue.problem(problem), np.asarray(seeds)
    if not isinstance(found, Scenario):
        return drawn_k_star(found, seeds).k_star
    known = reference(found)
    return np.full(len(seeds), float(known.k_star) if known else np.nan)


def k_star_digest(problem: ProblemLike) -> str | None:
    """Return the SHA-256 of the stored K* of a scenario or distribution, in hexadecimal digits; None without any.

    Scores with the same digest have the same yardstick, whatever else the table holds.
    """
    found = catalogue.problem(problem)
    known: Any = None
    if isinstance(found, Scenario):
        row = reference(found)
        known = row and {"k_star": row.k_star}
    elif found.name in _data()["draws"] and DISTRIBUTIONS.get(found.name) == found:
        known = {key: _data()["draws"][found.name][key] for key in ("first_seed", "k_star")}
    if known is None:
        return None
    return hashlib.sha256(json.dumps(known, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


@lru_cache
def _by_digest() -> dict[str, Reference]:
    """Return the best-known solutions by the digest of the scenario."""
    return {SCENARIOS[name].digest: best for name, best in _table().items() if name in SCENARIOS}


@lru_cache
def _distributions() -> dict[str, str]:
    """Return the names of the distributions by their digest."""
    return {distribution.digest: name for name, distribution in DISTRIBUTIONS.items()}


@lru_cache
def _states(name: str) -> Array:
    """Return the states of the K*-step solution of a named scenario, read-only, shape (K*+1, 5)."""
    scenario = SCENARIOS[name]
    states = [scenario.start_state]
    for control in scenario.quadrotor.control(_table()[name].actions):
        states.append(scenario.quadrotor.step(states[-1], control, scenario.dt))
    result = np.array(states)
    result.setflags(write=False)
    return result


@lru_cache
def _draws(name: str) -> tuple[int, Array]:
    """Return the first stored seed of a distribution, and K* and its lower bound from there on, shape (2, n)."""
    row = _data()["draws"][name]
    return row["first_seed"], np.array([row["k_star"], row["k_lower_bound"]], dtype=np.float64)


@lru_cache
def _table() -> dict[str, Reference]:
    """Return the best-known solutions by scenario name."""
    return {row["scenario"]: Reference.of(row) for row in _data()["references"]}


@lru_cache
def _data() -> dict[str, Any]:
    """Return the content of the file; read once."""
    data: dict[str, Any] = json.loads(files("flatgym.scenarios").joinpath(FILE).read_text(encoding="utf-8"))
    if data.get("schema") != SCHEMA:
        raise ValueError(f"flatgym/scenarios/{FILE} has schema {data.get('schema')!r}, this version reads {SCHEMA}")
    return data
