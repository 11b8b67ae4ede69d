"""Scores: how far from the fewest possible steps a policy flies.

    gap = K_agent / K* - 1  over the flights that reached the goal, always beside the success rate.

K* is the environment's own optimum (same step, same tolerance), never T*. A flight in fewer steps
than K* would prove K* wrong: it raises FasterThanOptimal with the flight attached.
"""

from __future__ import annotations

import platform
from collections import Counter
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import trim_mean

from flatgym.catalogue import ScenarioLike, scenario
from flatgym.disturbances import Disturbances
from flatgym.quadrotor import Array
from flatgym.scenario import Scenario
from flatgym.scene import OUTCOMES
from flatgym.vector import FlatQuadVectorEnv
from optimal.steps import FewestSteps, fewest_steps

CALM = Disturbances()
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

PACKAGES = ("flatgym", "gymnasium", "numpy", "numba", "casadi", "stable-baselines3", "torch")


class Policy(Protocol):
    """Anything with Stable-Baselines3's `predict`."""

    def predict(self, observation: Any, *, deterministic: bool = ...) -> tuple[Any, Any]:
        """Return actions (n, 2) for observations (n, 19), and a state that is ignored here."""


class FasterThanOptimal(AssertionError):
    """A flight took fewer steps than K*, so K* is wrong; `actions` and `states` are the evidence."""

    def __init__(self, problem: Scenario, k_star: float, actions: NDArray[np.float32], states: Array) -> None:
        self.problem, self.k_star, self.actions, self.states = problem, k_star, actions, states
        super().__init__(
            f"{problem.name!r} was flown in {len(actions)} steps, fewer than K* = {k_star}: K* is wrong; "
            "please report it with the attached actions"
        )


@dataclass(frozen=True)
class Flights:
    """Flights of one policy: `steps` (n,), `outcomes` (n words), and of each its states (K+1, 5) and actions (K, 2)."""

    steps: NDArray[np.int64]
    outcomes: tuple[str, ...]
    states: tuple[Array, ...]
    actions: tuple[NDArray[np.float32], ...]


def fly(
    policy: Policy,
    problem: ScenarioLike,
    episodes: int = 1,
    seed: int = 0,
    disturbances: Disturbances = CALM,
) -> Flights:
    """Fly `episodes` flights of a scenario at once, deterministically but for what the seed draws.

    Raises:
        ValueError: when the policy returns actions of a wrong shape, NaN or infinity.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    envs = FlatQuadVectorEnv(episodes, scenario=problem, reward="sparse", **asdict(disturbances))
    observations, infos = envs.reset(seed=seed)
    states, actions = [infos["state"]], []
    steps, outcomes = np.zeros(episodes, dtype=np.int64), np.full(episodes, OUTCOMES[0], dtype=object)
    while (flying := outcomes == OUTCOMES[0]).any():
        action = np.asarray(policy.predict(observations, deterministic=True)[0])
        observations, _, _, _, infos = envs.step(action)
        actions.append(np.clip(action, -1, 1).astype(np.float32))
        states.append(infos["state"])
        steps[flying], outcomes[flying] = infos["steps"][flying], infos["outcome"][flying]
    return Flights(
        steps,
        tuple(map(str, outcomes)),
        tuple(np.array([state[i] for state in states[: steps[i] + 1]]) for i in range(episodes)),
        tuple(np.array([action[i] for action in actions[: steps[i]]]) for i in range(episodes)),
    )


def evaluate(
    policy: Policy,
    problem: ScenarioLike,
    episodes: int = 10,
    seed: int = 0,
    *,
    optimum: FewestSteps | None = None,
    disturbances: Disturbances = CALM,
    **columns: Any,
) -> pd.DataFrame:
    """Return the score of a policy on a scenario: a table of one row, columns COLUMNS.

    Args:
        policy: anything with `predict(observations, deterministic=True)`.
        problem: a scenario or its name.
        episodes: flights to fly; `steps` is the interquartile mean over those that succeed.
        seed: seed of the environment.
        optimum: K*, if it is known already; else it is computed. It is that of the undisturbed vehicle.
        disturbances: what stands against the vehicle, each flight its own draw; the row states which were on.
        columns: further columns of the row: agent, algorithm, env_steps, wall_time_s, command.

    Raises:
        FasterThanOptimal: when an undisturbed flight needs fewer steps than K*; a tail wind may well.
        ValueError: for an unknown column.
    """
    unknown = set(columns) - set(COLUMNS)
    if unknown:
        raise ValueError(f"unknown columns {sorted(unknown)}; known: {', '.join(COLUMNS)}")
    target = scenario(problem)
    optimum = optimum or fewest_steps(target)
    flights = fly(policy, target, episodes, seed, disturbances)
    succeeded = np.array([word == "goal" for word in flights.outcomes])
    comparable = not disturbances.active
    for i in np.flatnonzero(succeeded & (flights.steps < optimum.steps) & comparable):
        raise FasterThanOptimal(target, optimum.steps, flights.actions[i], flights.states[i])
    steps = float(trim_mean(flights.steps[succeeded], 0.25)) if succeeded.any() else float("nan")
    row: dict[str, Any] = {
        "scenario": target.name,
        "agent": type(policy).__name__,
        "algorithm": type(policy).__name__,
        "seed": seed,
        "episodes": episodes,
        "success_rate": float(succeeded.mean()),
        "steps": steps,
        "k_star": int(optimum.steps),
        "proven": optimum.proven,
        "gap": steps / optimum.steps - 1,
        "outcomes": dict(Counter(flights.outcomes)),
        "disturbances": disturbances.active,
        "env_steps": None,
        "wall_time_s": None,
        "command": None,
        "versions": versions(),
    }
    return pd.DataFrame([row | columns], columns=list(COLUMNS))


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages a score depends on."""
    return {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}
