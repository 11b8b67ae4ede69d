"""Scores: how far from the fewest possible steps a policy flies.

    gap = K_agent / K* - 1  over the flights that reached the goal, always beside the success rate.

K* is the environment's own optimum (same step, same tolerance), never T*; on a distribution every flight is
measured against the K* of its own scenario. A flight in fewer steps than K* would prove K* wrong: it raises
FasterThanOptimal with the flight attached.

The protocol: policies fly deterministically, the first flight with seed EVALUATION_SEED = 1,000,000 and the others
counting on from it; trainings keep to smaller seeds, so that goals, hoops and disturbances of a score are unseen.
The K* of these scenarios is shipped (`flatgym.reference`), and a score needs no solver.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.evaluation.bootstrap import iqm
from agents.evaluation.optima import Optima, optima
from agents.evaluation.rollouts import CALM, Flights, fly
from agents.evaluation.versions import versions
from agents.policies.policy import Policy
from flatgym.quadrotor import Array
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import ProblemLike
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.reference import EVALUATION_SEED
from flatgym.scenarios.scenario import Scenario
from optimal.discrete.fewest_steps import FewestSteps

COLUMNS = (
    "scenario",
    "agent",
    "algorithm",
    "seed",
    "episodes",
    "success_rate",
    "steps",
    "k_star",
    "proven",
    "gap",
    "outcomes",
    "disturbances",
    "env_steps",
    "wall_time_s",
    "command",
    "versions",
)
"""Columns of a score row, the same in tables, JSON and CSV."""


class FasterThanOptimal(AssertionError):
    """A flight took fewer steps than K*, so K* is wrong; `scenario`, `actions` and `states` are the evidence."""

    def __init__(self, scenario: Scenario, k_star: float, actions: NDArray[np.float32], states: Array) -> None:
        self.scenario, self.k_star, self.actions, self.states = scenario, k_star, actions, states
        super().__init__(
            f"{scenario.name!r} was flown in {len(actions)} steps, fewer than K* = {k_star}: K* is wrong; "
            "please report it with the attached actions"
        )


def flight_rows(
    policy: Policy,
    problem: ProblemLike,
    episodes: int = 10,
    seed: int = EVALUATION_SEED,
    *,
    optimum: FewestSteps | None = None,
    disturbances: Disturbances = CALM,
    store: str | Path | None = None,
) -> pd.DataFrame:
    """Fly, and return one row a flight: scenario, seed, outcome, steps, k_star, proven, gap (NaN where it failed).

    Args:
        policy, problem, episodes, seed, disturbances: as in `fly`; `scenario` is the problem's name, and the seed that
            of the flight.
        optimum: K* of the scenario, if it is known already. It is that of the undisturbed vehicle.
        store: a folder in which K* that had to be computed are kept, and looked up.

    Raises:
        FasterThanOptimal: when an undisturbed flight needs fewer steps than K*; with a tail wind it may well.
        SolveFailed: when no K* is found at all; where some are not, their gap is NaN.
        ValueError: as in `fly`; for an optimum of another scenario.
    """
    target = catalogue.problem(problem)
    if optimum is not None and optimum.scenario != target:
        raise ValueError(f"optimum must be one of {target.name!r}, got that of {optimum.scenario.name!r}")
    flights = fly(policy, target, episodes, seed, disturbances)
    return score_flights(flights, target, seed, optimum=optimum, disturbances=disturbances, store=store)


def score_flights(
    flights: Flights,
    problem: ProblemLike,
    seed: int = EVALUATION_SEED,
    *,
    optimum: FewestSteps | None = None,
    disturbances: Disturbances = CALM,
    store: str | Path | None = None,
) -> pd.DataFrame:
    """Return one row for each episode, as `flight_rows` does, of episodes that `fly` has returned.

    Args:
        flights: the episodes, with consecutive seeds.
        problem, seed, optimum, disturbances, store: as in `flight_rows`.

    Raises:
        FasterThanOptimal, SolveFailed: as in `flight_rows`.
    """
    target = catalogue.problem(problem)
    seeds = seed + np.arange(len(flights.steps))
    k_star, proven = optima(target, seeds, store) if optimum is None else Optima.of([optimum]).repeat(len(seeds))
    succeeded = np.array([word == "goal" for word in flights.outcomes])
    for i in np.flatnonzero(succeeded & (flights.steps < k_star) & (not disturbances.active)):
        flown = target if isinstance(target, Scenario) else target.scenario(int(seeds[i]))
        raise FasterThanOptimal(flown, k_star[i], flights.actions[i], flights.states[i])
    return pd.DataFrame(
        {
            "scenario": target.name,
            "seed": seeds,
            "outcome": flights.outcomes,
            "steps": flights.steps,
            "k_star": k_star,
            "proven": proven,
            "gap": np.where(succeeded, flights.steps / k_star - 1, np.nan),
        }
    )


def evaluate(
    policy: Policy,
    problem: ProblemLike,
    episodes: int = 10,
    seed: int = EVALUATION_SEED,
    *,
    optimum: FewestSteps | None = None,
    disturbances: Disturbances = CALM,
    store: str | Path | None = None,
    **columns: Any,
) -> pd.DataFrame:
    """Return the score of a policy on a scenario or a distribution: a table of one row, columns COLUMNS.

    `steps` and `gap` are interquartile means over the flights that succeed, `k_star` that of the same flights, `proven`
    whether all of these K* are; what the row says of disturbances is which were on.

    Args:
        policy, problem, episodes, seed, optimum, disturbances, store: as in `flight_rows`.
        columns: further columns of the row: agent, algorithm, env_steps, wall_time_s, command.

    Raises:
        FasterThanOptimal, SolveFailed: as in `flight_rows`.
        ValueError: as there, and for an unknown column.
    """
    unknown = set(columns) - set(COLUMNS)
    if unknown:
        raise ValueError(f"unknown columns {sorted(unknown)}; known: {', '.join(COLUMNS)}")
    rows = flight_rows(policy, problem, episodes, seed, optimum=optimum, disturbances=disturbances, store=store)
    succeeded = rows["outcome"] == "goal"
    judged = rows[succeeded] if succeeded.any() else rows
    row: dict[str, Any] = {
        "scenario": rows["scenario"].iloc[0],
        "agent": type(policy).__name__,
        "algorithm": type(policy).__name__,
        "seed": seed,
        "episodes": episodes,
        "success_rate": float(succeeded.mean()),
        "steps": float(iqm(rows["steps"].where(succeeded))),
        "k_star": float(iqm(judged["k_star"])),
        "proven": bool(judged["proven"].all()),
        "gap": float(iqm(rows["gap"])),
        "outcomes": dict(Counter(rows["outcome"])),
        "disturbances": disturbances.active,
        "env_steps": None,
        "wall_time_s": None,
        "command": None,
        "versions": versions(),
    }
    if row["k_star"].is_integer():
        row["k_star"] = int(row["k_star"])
    return pd.DataFrame([row | columns], columns=list(COLUMNS))
