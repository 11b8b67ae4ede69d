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

import platform
from collections import Counter
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from agents.intervals import iqm
from agents.optima import Optima, optima
from flatgym import catalogue
from flatgym.catalogue import ProblemLike
from flatgym.disturbances import Disturbances
from flatgym.quadrotor import Array
from flatgym.reference import EVALUATION_SEED
from flatgym.scenario import Scenario
from flatgym.scene import OUTCOMES
from flatgym.vector import FlatQuadVectorEnv
from optimal.steps import FewestSteps

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
    """Anything with Stable-Baselines3's `predict`; recurrent and stateful policies included."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Return actions (n, 2) for observations (n, 19), and what the policy wants handed back as `state`.

        Args:
            observation: float32, shape (n, 19).
            state: what the last call returned; None at first.
            episode_start: which flights begin with these observations, shape (n,).
            deterministic: whether nothing is to be drawn.
        """


class FasterThanOptimal(AssertionError):
    """A flight took fewer steps than K*, so K* is wrong; `scenario`, `actions` and `states` are the evidence."""

    def __init__(self, scenario: Scenario, k_star: float, actions: NDArray[np.float32], states: Array) -> None:
        self.scenario, self.k_star, self.actions, self.states = scenario, k_star, actions, states
        super().__init__(
            f"{scenario.name!r} was flown in {len(actions)} steps, fewer than K* = {k_star}: K* is wrong; "
            "please report it with the attached actions"
        )


@dataclass(frozen=True)
class Flights:
    """Flights of one policy.

    Attributes:
        steps: environment steps until each ended, shape (n,).
        outcomes: how each ended, n words of OUTCOMES.
        hoops_passed: shape (n,).
        states: of each flight, from its start to its end, shapes (K+1, 5).
        actions: of each flight, within the action space, float32, shapes (K, 2).
    """

    steps: NDArray[np.int64]
    outcomes: tuple[str, ...]
    hoops_passed: NDArray[np.int64]
    states: tuple[Array, ...]
    actions: tuple[NDArray[np.float32], ...]


def fly(
    policy: Policy,
    problem: ProblemLike,
    episodes: int = 1,
    seed: int = 0,
    disturbances: Disturbances = CALM,
) -> Flights:
    """Fly `episodes` flights at once, deterministically but for what the seed draws.

    Args:
        policy: anything with Stable-Baselines3's `predict`.
        problem: a scenario or a distribution; of the latter flight i is through `distribution.scenario(seed + i)`.
        episodes: number of flights.
        seed: of the first flight, the others counting on from it.
        disturbances: what stands against the vehicle, each flight its own draw.

    Raises:
        ValueError: when the spaces of the policy are not those of the environment, before anything is flown; when it
            returns actions of a wrong shape, NaN or infinity.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    envs = FlatQuadVectorEnv(episodes, scenario=problem, reward="sparse", **asdict(disturbances))
    check_spaces(policy, envs)
    observations, infos = envs.reset(seed=seed)
    states, actions, memory = [infos["state"]], [], None
    steps, passed = np.zeros((2, episodes), dtype=np.int64)
    outcomes = np.full(episodes, OUTCOMES[0], dtype=object)
    starts, ended = np.ones(episodes, dtype=bool), np.zeros(episodes, dtype=bool)
    while (flying := outcomes == OUTCOMES[0]).any():
        action, memory = policy.predict(observations, state=memory, episode_start=starts, deterministic=True)
        observations, _, terminated, truncated, infos = envs.step(np.asarray(action))
        # Who ended flies on; the environment begins his next flight a step later.
        starts, ended = ended, terminated | truncated
        actions.append(np.clip(action, -1, 1).astype(np.float32))
        states.append(infos["state"])
        steps[flying], outcomes[flying] = infos["steps"][flying], infos["outcome"][flying]
        passed[flying] = infos["hoops_passed"][flying]
    return Flights(
        steps,
        tuple(map(str, outcomes)),
        passed,
        tuple(np.array([state[i] for state in states[: steps[i] + 1]]) for i in range(episodes)),
        tuple(np.array([action[i] for action in actions[: steps[i]]]) for i in range(episodes)),
    )


def check_spaces(policy: Policy, envs: FlatQuadVectorEnv) -> None:
    """Refuse a policy that says it sees or does other things than the environment shows and takes.

    Raises:
        ValueError: naming both shapes.
    """
    for name in ("observation_space", "action_space"):
        wanted, space = getattr(envs, f"single_{name}"), getattr(policy, name, None)
        if space is not None and space.shape != wanted.shape:
            raise ValueError(
                f"the policy has an {name} of shape {space.shape}, {space}, but FlatQuad-v0 one of shape "
                f"{wanted.shape}; train it in FlatQuad-v0, or hand over an object whose predict() converts"
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
    seeds = seed + np.arange(episodes)
    k_star, proven = optima(target, seeds, store) if optimum is None else Optima.of([optimum]).repeat(episodes)
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


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages a score depends on."""
    return {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}
