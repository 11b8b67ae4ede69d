"""Scores: success rate, and the gap of a policy to the fewest possible steps.

    gap = K_agent / K* - 1  over the episodes that reached the goal, always reported with the success rate.

K* is the environment's own optimum (same step, same tolerance), not T*. On a distribution each episode is compared
with the K* of its own scenario. An episode in fewer steps than K* disproves K*; it raises FasterThanOptimal with the
episode attached.

Protocol: policies are deterministic. Episode i has seed EVALUATION_SEED + i = 1,000,000 + i. Trainings use smaller
seeds, so goals, hoops and disturbances of a score are unseen. K* of these scenarios is shipped
(`flatgym.scenarios.reference`), and a score needs no solver.
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
from agents.evaluation.rollouts import NO_DISTURBANCES, Episodes, fly
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
    """An episode took fewer steps than K*, which disproves K*; holds `scenario`, `actions` and `states`."""

    def __init__(self, scenario: Scenario, k_star: float, actions: NDArray[np.float32], states: Array) -> None:
        self.scenario, self.k_star, self.actions, self.states = scenario, k_star, actions, states
        super().__init__(
            f"{scenario.name!r} was flown in {len(actions)} steps, fewer than K* = {k_star}: K* is wrong; "
            "please report it with the attached actions"
        )


def episode_rows(
    policy: Policy,
    problem: ProblemLike,
    episodes: int = 10,
    seed: int = EVALUATION_SEED,
    *,
    optimum: FewestSteps | None = None,
    disturbances: Disturbances = NO_DISTURBANCES,
    store: str | Path | None = None,
) -> pd.DataFrame:
    """Return one row per episode: scenario, seed, outcome, steps, k_star, proven, gap (NaN for a failed episode).

    Args:
        policy, problem, episodes, seed, disturbances: as in `fly`. The column `scenario` is the problem's label, `seed`
            the seed of the episode.
        optimum: K* of the scenario without disturbances, if known.
        store: folder that caches computed K*.

    Raises:
        FasterThanOptimal: if an episode without disturbances takes fewer steps than K*. With disturbances, such as a
            tail wind, it may.
        SolveFailed: if no K* is found at all; if some are missing, their gap is NaN.
        ValueError: as in `fly`; for an optimum of another scenario.
    """
    target = catalogue.problem(problem)
    if optimum is not None and optimum.scenario != target:
        raise ValueError(f"optimum must be one of {target.name!r}, got that of {optimum.scenario.name!r}")
    rollouts = fly(policy, target, episodes, seed, disturbances)
    return score_episodes(rollouts, target, seed, optimum=optimum, disturbances=disturbances, store=store)


def score_episodes(
    rollouts: Episodes,
    problem: ProblemLike,
    seed: int = EVALUATION_SEED,
    *,
    optimum: FewestSteps | None = None,
    disturbances: Disturbances = NO_DISTURBANCES,
    store: str | Path | None = None,
) -> pd.DataFrame:
    """Return one row per episode, as `episode_rows` does, for episodes that `fly` returned.

    Args:
        rollouts: the episodes, with consecutive seeds.
        problem, seed, optimum, disturbances, store: as in `episode_rows`.

    Raises:
        FasterThanOptimal, SolveFailed: as in `episode_rows`.
    """
    target = catalogue.problem(problem)
    seeds = seed + np.arange(len(rollouts.steps))
    k_star, proven = optima(target, seeds, store) if optimum is None else Optima.of([optimum]).repeat(len(seeds))
    succeeded = np.array([word == "goal" for word in rollouts.outcomes])
    for i in np.flatnonzero(succeeded & (rollouts.steps < k_star) & (not disturbances.active)):
        scenario = target if isinstance(target, Scenario) else target.scenario(int(seeds[i]))
        raise FasterThanOptimal(scenario, k_star[i], rollouts.actions[i], rollouts.states[i])
    return pd.DataFrame(
        {
            "scenario": catalogue.label(target),
            "seed": seeds,
            "outcome": rollouts.outcomes,
            "steps": rollouts.steps,
            "k_star": k_star,
            "proven": proven,
            "gap": np.where(succeeded, rollouts.steps / k_star - 1, np.nan),
        }
    )


def evaluate(
    policy: Policy,
    problem: ProblemLike,
    episodes: int = 10,
    seed: int = EVALUATION_SEED,
    *,
    optimum: FewestSteps | None = None,
    disturbances: Disturbances = NO_DISTURBANCES,
    store: str | Path | None = None,
    **columns: Any,
) -> pd.DataFrame:
    """Return the score of a policy on a scenario or a distribution: a table of one row with COLUMNS.

    `steps` and `gap` are interquartile means over the successful episodes, `k_star` is that of the same episodes, and
    `proven` tells whether all their K* are proven. `disturbances` holds the active disturbances.

    Args:
        policy, problem, episodes, seed, optimum, disturbances, store: as in `episode_rows`.
        columns: further columns of the row: agent, algorithm, env_steps, wall_time_s, command.

    Raises:
        FasterThanOptimal, SolveFailed: as in `episode_rows`.
        ValueError: as there, and for an unknown column.
    """
    unknown = set(columns) - set(COLUMNS)
    if unknown:
        raise ValueError(f"unknown columns {sorted(unknown)}; known: {', '.join(COLUMNS)}")
    rows = episode_rows(policy, problem, episodes, seed, optimum=optimum, disturbances=disturbances, store=store)
    succeeded = rows["outcome"] == "goal"
    scored = rows[succeeded] if succeeded.any() else rows
    row: dict[str, Any] = {
        "scenario": rows["scenario"].iloc[0],
        "agent": type(policy).__name__,
        "algorithm": type(policy).__name__,
        "seed": seed,
        "episodes": episodes,
        "success_rate": float(succeeded.mean()),
        "steps": float(iqm(rows["steps"].where(succeeded))),
        "k_star": float(iqm(scored["k_star"])),
        "proven": bool(scored["proven"].all()),
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
