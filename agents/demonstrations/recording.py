"""Recording: flights are replayed in the environment and stored as a Minari dataset, atomically.

The dataset holds the environment's own observations and rewards. Every flight must end in the outcome "goal" at its
K-th step. Each episode stores how to reset the environment for a replay:

    env = dataset.recover_environment()
    env.reset(seed=seed, options=options)

An episode also holds the states, in `infos["state"]`, and as metadata k_star, lower_bound, proven, tolerance_used,
winding and the scenario.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import minari
import numpy as np
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_storage import MinariStorage

from agents.demonstrations.storage import atomic_dataset, dataset_id
from flatgym import __version__, observation_names
from flatgym.scenarios.catalogue import Problem, ProblemLike, text
from flatgym.scenarios.catalogue import problem as problem_named
from flatgym.scenarios.distributions import Distribution
from flatgym.scenarios.reference import EVALUATION_SEED
from flatgym.scenarios.scenario import Scenario
from optimal.discrete.fewest_steps import FewestSteps

ENVIRONMENT = "FlatQuad-v0"
"""The environment of demonstrations."""
BATCH = 100
"""Episodes per write."""

Progress = Callable[[int, int], None]
"""Called with the number done and the total."""


def no_progress(*counts: int) -> None:
    """Ignore the progress."""


@dataclass(frozen=True)
class Demonstration:
    """A flight to record, and the reset of the environment for it.

    Attributes:
        scenario: scenario of the environment.
        flight: the flight; its start may differ from the scenario's.
        seed: seed of the reset.
        hoops_passed: hoops that count as passed at the start.
    """

    scenario: Scenario
    flight: FewestSteps
    seed: int = 0
    hoops_passed: int = 0

    @property
    def steps(self) -> int:
        """Steps from the start of the flight to the goal."""
        return len(self.flight.actions)

    @property
    def options(self) -> dict[str, Any] | None:
        """Options of the reset; None for the scenario's own start."""
        state = self.flight.states[0]
        if not self.hoops_passed and np.array_equal(state, self.scenario.start_state):
            return None
        return {"state": state, "hoops_passed": self.hoops_passed}


def record(
    problem: ProblemLike,
    demonstrations: Sequence[Demonstration],
    name: str | None = None,
    *,
    progress: Progress = no_progress,
) -> minari.MinariDataset:
    """Replay demonstrations in the environment and store them; an older dataset of the name is replaced.

    Args:
        problem: the scenario of the environment, or the distribution of all demonstrations.
        demonstrations: flights of this problem.
        name: Minari's dataset id; by default `dataset_id(problem)`.
        progress: called with the number recorded and the total.

    Raises:
        ValueError: for no demonstrations.
        RuntimeError: if a flight does not end in the outcome "goal" at its K-th step.
        OSError: if the dataset cannot be written. After any error an older dataset is unchanged.
    """
    target, identity = problem_named(problem), dataset_id(problem, name)
    if not demonstrations:
        raise ValueError(f"no demonstrations of {target.name!r} to record")
    if isinstance(target, Distribution):
        _warn_of_scored_tasks(max(demonstration.seed for demonstration in demonstrations))
    env = gym.make(ENVIRONMENT, scenario=text(target), reward="sparse")
    with atomic_dataset(identity, sum(map(_size, demonstrations))) as folder:
        storage = MinariStorage.new(folder, env_spec=env.spec)
        for begin in range(0, len(demonstrations), BATCH):
            batch = demonstrations[begin : begin + BATCH]
            storage.update_episodes([_replay(env, demonstration) for demonstration in batch])
            progress(begin + len(batch), len(demonstrations))
        storage.update_episode_metadata([_facts(demonstration) for demonstration in demonstrations])
        storage.update_metadata(_metadata(identity, target, demonstrations, env))
    env.close()
    return minari.load_dataset(identity)


def _warn_of_scored_tasks(last_seed: int) -> None:
    """Warn if the flights show tasks of scored episodes, which a policy that is scored must not have seen."""
    if last_seed >= EVALUATION_SEED:
        warnings.warn(
            f"the dataset shows tasks that score policies, those of seeds from {EVALUATION_SEED} on (its last seed is "
            f"{last_seed}); do not train on it, or plan with a smaller seed",
            stacklevel=3,
        )


def _replay(env: gym.Env[Any, Any], demonstration: Demonstration) -> EpisodeBuffer:
    """Replay a demonstration and return its episode.

    Raises:
        RuntimeError: if the environment has another scenario, or the flight does not end as planned.
    """
    observation, info = env.reset(seed=demonstration.seed, options=demonstration.options)
    if env.unwrapped.scenario != demonstration.scenario:  # type: ignore[attr-defined]
        raise RuntimeError(
            f"seed {demonstration.seed} gives {env.unwrapped.scenario}, "  # type: ignore[attr-defined]
            f"not {demonstration.scenario}"
        )
    observations, states, answers = [observation], [info["state"]], []
    for action in demonstration.flight.actions:
        observation, *answer, info = env.step(action)
        observations.append(observation)
        states.append(info["state"])
        answers.append(answer)
        if info["outcome"] != "flying":
            break
    if info["outcome"] != "goal" or info["steps"] != demonstration.steps:
        raise RuntimeError(
            f"{demonstration.scenario.name!r}: a planned flight of {demonstration.steps} steps ended as {info}"
        )
    rewards, terminations, truncations = zip(*answers, strict=True)
    return EpisodeBuffer(
        seed=demonstration.seed,
        options=demonstration.options,
        observations=np.array(observations),
        actions=demonstration.flight.actions,
        rewards=np.array(rewards),
        terminations=np.array(terminations),
        truncations=np.array(truncations),
        infos={"state": np.array(states)},
    )


def _facts(demonstration: Demonstration) -> dict[str, Any]:
    """Return the metadata of an episode."""
    flight = demonstration.flight
    return {
        "k_star": demonstration.steps,
        "lower_bound": flight.lower_bound,
        "proven": flight.proven,
        "tolerance_used": flight.tolerance_used,
        "winding": flight.winding,
        "scenario": demonstration.scenario.to_json(),
    }


def _metadata(
    identity: str, target: Problem, demonstrations: Sequence[Demonstration], env: gym.Env[Any, Any]
) -> dict[str, Any]:
    """Return the metadata of a dataset: Minari's fields, and those that `agents.demonstrations.check` reads.

    Reference scores: the minimum is minus the time limit, of a failed episode; the maximum is minus the mean time of
    the flights from the scenarios' own starts.
    """
    assert env.spec is not None
    from_start = [one.steps for one in demonstrations if one.options is None]
    return {
        "dataset_id": identity,
        "eval_env_spec": env.spec.to_json(),
        "algorithm_name": "optimal.fewest_steps",
        "author": {"FlatQuad"},
        "author_email": {""},
        "code_permalink": "",
        "description": f"Fewest-steps flights of {target.name!r}, flatgym {__version__}; reward: minus time.",
        "requirements": [f"flatgym=={__version__}"],
        "minari_version": minari.__version__,
        "ref_min_score": -target.time_limit,
        "ref_max_score": -target.dt * float(np.mean(from_start or [one.steps for one in demonstrations])),
        "num_episodes_average_score": len(from_start or demonstrations),
        "flatgym_version": __version__,
        "observation_names": list(observation_names()),
        "problem": target.to_json(),
    }


def _size(demonstration: Demonstration) -> int:
    """Return an upper bound of an episode's size on disk [bytes]."""
    return 32_000 + 300 * demonstration.steps
