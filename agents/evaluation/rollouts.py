"""Rollouts: deterministic episodes of a policy in the environment, as a batch.

fly(policy, "random-goal", episodes=100, seed=0).steps
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policies.actions import as_array
from agents.policies.policy import Policy
from agents.policies.spaces import fit
from flatgym.envs.vector import FlatQuadVectorEnv
from flatgym.quadrotor import Array
from flatgym.scenarios.catalogue import ProblemLike
from flatgym.scenarios.disturbances import Disturbances
from flatgym.task.scene import OUTCOMES
from flatgym.validation import numbers

NO_DISTURBANCES = Disturbances()


@dataclass(frozen=True)
class Episodes:
    """Episodes of one policy.

    Attributes:
        steps: environment steps of each episode, shape (n,).
        outcomes: outcome of each episode, n words of OUTCOMES.
        passed: hoops passed at each state, n arrays of shape (K+1,).
        states: states of each episode, n arrays of shape (K+1, 5).
        actions: actions of each episode, clipped to the action space, n float32 arrays of shape (K, 2).
    """

    steps: NDArray[np.int64]
    outcomes: tuple[str, ...]
    passed: tuple[NDArray[np.int64], ...]
    states: tuple[Array, ...]
    actions: tuple[NDArray[np.float32], ...]

    @property
    def hoops_passed(self) -> NDArray[np.int64]:
        """Hoops passed in each episode, shape (n,)."""
        return np.array([passed[-1] for passed in self.passed])


def fly(
    policy: Policy,
    problem: ProblemLike,
    episodes: int = 1,
    seed: int = 0,
    disturbances: Disturbances = NO_DISTURBANCES,
) -> Episodes:
    """Roll out a deterministic policy in a batch of episodes, and return them.

    Args:
        policy: any object with Stable-Baselines3's `predict`. Its observation space, if it has one, decides whether it
            receives features or states, and how many frames of them; see `agents.policies.spaces`.
        problem: a scenario or a distribution; episode i of a distribution has `distribution.scenario(seed + i)`.
        episodes: number of episodes.
        seed: seed of the first episode; episode i has seed + i.
        disturbances: disturbances, sampled for each episode.

    Raises:
        ValueError: if the spaces of the policy do not fit the environment, before the first step; if it returns
            actions of a wrong shape, NaN or infinity.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    policy, observation = fit(policy)
    envs = FlatQuadVectorEnv(
        episodes, scenario=problem, reward="sparse", observation=observation, **asdict(disturbances)
    )
    observations, infos = envs.reset(seed=seed)
    states, passed, actions, memory = [infos["state"]], [infos["hoops_passed"]], [], None
    steps = np.zeros(episodes, dtype=np.int64)
    outcomes = np.full(episodes, OUTCOMES[0], dtype=object)
    starts, ended = np.ones(episodes, dtype=bool), np.zeros(episodes, dtype=bool)
    while (flying := outcomes == OUTCOMES[0]).any():
        action, memory = policy.predict(observations, state=memory, episode_start=starts, deterministic=True)
        flown = in_space(action)
        observations, _, terminated, truncated, infos = envs.step(flown)
        # Ended episodes keep stepping; the environment resets them a step later.
        starts, ended = ended, terminated | truncated
        actions.append(flown)
        states.append(infos["state"])
        passed.append(infos["hoops_passed"])
        steps[flying], outcomes[flying] = infos["steps"][flying], infos["outcome"][flying]
    return Episodes(
        steps,
        tuple(map(str, outcomes)),
        by_episode(passed, steps + 1),
        by_episode(states, steps + 1),
        by_episode(actions, steps),
    )


def by_episode(rows: Sequence[NDArray[Any]], counts: NDArray[np.int64]) -> tuple[NDArray[Any], ...]:
    """Return the first `counts[i]` entries of episode i, from rows with an entry for each of n episodes."""
    together = np.array(rows)
    return tuple(together[:count, i].copy() for i, count in enumerate(counts))


def in_space(action: Any) -> NDArray[np.float32]:
    """Return actions clipped and rounded to the action space, so that what is recorded is what was flown.

    NaN and infinity are kept, which the environment refuses.

    Raises:
        ValueError: for values that are not numbers.
    """
    values = numbers("actions", as_array(action))
    return np.where(np.isfinite(values), np.clip(values, -1, 1), values).astype(np.float32)
