"""Recording: flights are replayed in the environment and stored as a Minari dataset, atomically.

The dataset holds the environment's own observations and rewards. Every flight must end in the outcome "goal" at its
K-th step. Each episode stores how to reset the environment for a replay:

    env = dataset.recover_environment()
    env.reset(seed=seed, options=options)

An episode also holds the states, in `infos["state"]`, and as metadata k_star, lower_bound, proven, tolerance_used,
winding and the scenario. An existing dataset is replaced or extended only if that is asked for.
"""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import minari
import numpy as np
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_storage import MinariStorage

from agents.demonstrations.metadata import ENVIRONMENT, Facts, dataset_metadata, episode_facts
from agents.demonstrations.storage import atomic_dataset, dataset_id, dataset_path
from agents.demonstrations.verification import check
from flatgym.scenarios.catalogue import ProblemLike, text
from flatgym.scenarios.catalogue import problem as problem_named
from flatgym.scenarios.distributions import Distribution
from flatgym.scenarios.reference import EVALUATION_SEED
from flatgym.scenarios.scenario import Scenario
from flatgym.validation import choice
from optimal.discrete.fewest_steps import FewestSteps

IF_EXISTS = ("fail", "replace", "append")
"""What `record` may do with an existing dataset."""
SET_ONCE = ("dataset_id", "minari_version")
"""Fields that Minari does not change once they are set."""
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


def stored_dataset(
    problem: ProblemLike, name: str | None = None, if_exists: str = "fail"
) -> minari.MinariDataset | None:
    """Return the dataset that `record` extends under these arguments, or None if it writes a new one.

    Raises:
        ValueError: for an existing dataset if `if_exists` is "fail", or one that is damaged or of another problem if it
            is "append".
    """
    identity = dataset_id(problem, name)
    choice("if_exists", if_exists, IF_EXISTS)
    if if_exists == "replace" or not (dataset_path(identity) / "data").exists():
        return None
    try:
        dataset = minari.load_dataset(identity)
        _facts_of(dataset.storage)
    except Exception as error:  # Minari and h5py raise many kinds for a damaged dataset
        raise ValueError(
            f"dataset {identity!r} exists and cannot be read ({error}); restore it, replace it (--overwrite, "
            'if_exists="replace"), or choose another name (--out, name=)'
        ) from error
    if if_exists == "fail":
        raise ValueError(
            f"dataset {identity!r} exists, with {dataset.total_episodes} episodes: extend it (--append, "
            'if_exists="append"), replace it (--overwrite, if_exists="replace"), or choose another name (--out, name=)'
        )
    check(dataset, problem)
    return dataset


def next_seed(dataset: minari.MinariDataset) -> int:
    """Return the first seed above those of all episodes of a dataset."""
    return 1 + max(known["seed"] for known in _facts_of(dataset.storage))


def record(
    problem: ProblemLike,
    demonstrations: Sequence[Demonstration],
    name: str | None = None,
    *,
    if_exists: str = "fail",
    progress: Progress = no_progress,
) -> minari.MinariDataset:
    """Replay demonstrations in the environment and store them as a dataset.

    Args:
        problem: the scenario of the environment, or the distribution of all demonstrations.
        demonstrations: flights of this problem.
        name: Minari's dataset id; by default `dataset_id(problem)`.
        if_exists: what to do if there is a dataset of this name: "fail", "replace", or "append" to it.
        progress: called with the number recorded and the total.

    Raises:
        ValueError: for no demonstrations, an existing dataset if `if_exists` is "fail", or one that is of another
            problem or holds one of the episodes if it is "append".
        RuntimeError: if a flight does not end in the outcome "goal" at its K-th step.
        OSError: if the dataset cannot be written. After any error an older dataset is unchanged.
    """
    target, identity = problem_named(problem), dataset_id(problem, name)
    if not demonstrations:
        raise ValueError(f"no demonstrations of {target.name!r} to record")
    before = stored_dataset(problem, name, if_exists)
    size = sum(map(_size, demonstrations))
    if before is not None:
        _check_new(before, demonstrations)
        size += sum(file.stat().st_size for file in Path(before.storage.data_path).iterdir())
    if isinstance(target, Distribution):
        _warn_of_scored_tasks(max(demonstration.seed for demonstration in demonstrations))
    env = gym.make(ENVIRONMENT, scenario=text(target), reward="sparse")
    with atomic_dataset(identity, size) as folder:
        if before is None:
            storage, first = MinariStorage.new(folder, env_spec=env.spec), 0
        else:
            shutil.copytree(before.storage.data_path, folder)
            storage, first = MinariStorage.read(folder), int(before.total_episodes)
        for begin in range(0, len(demonstrations), BATCH):
            batch = demonstrations[begin : begin + BATCH]
            storage.update_episodes([_replay(env, demonstration) for demonstration in batch])
            progress(begin + len(batch), len(demonstrations))
        storage.update_episode_metadata(
            [episode_facts(one.flight, one.scenario.to_json()) for one in demonstrations],
            range(first, first + len(demonstrations)),
        )
        fields = dataset_metadata(identity, target, _facts_of(storage), env)
        storage.update_metadata({key: value for key, value in fields.items() if not first or key not in SET_ONCE})
    env.close()
    return minari.load_dataset(identity)


def _facts_of(storage: MinariStorage) -> list[Facts]:
    """Return the metadata of all episodes."""
    return list(storage.get_episode_metadata(range(storage.total_episodes)))


def _check_new(before: minari.MinariDataset, demonstrations: Sequence[Demonstration]) -> None:
    """Raise a ValueError if a dataset already holds one of the episodes: one from the same state of a scenario."""
    stored = set()
    for known in _facts_of(before.storage):
        scenario = Scenario.from_json(known["scenario"])
        options = known.get("options") or {"state": scenario.start_state, "hoops_passed": 0}
        stored.add((scenario, options["state"].tobytes(), int(options["hoops_passed"])))
    for one in demonstrations:
        if (one.scenario, one.flight.states[0].tobytes(), one.hoops_passed) in stored:
            raise ValueError(
                f"dataset {before.id!r} already holds the episode with seed {one.seed} of {one.scenario.name!r}; its "
                f"first unused seed is {next_seed(before)}"
            )


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


def _size(demonstration: Demonstration) -> int:
    """Return an upper bound of an episode's size on disk [bytes]."""
    return 32_000 + 300 * demonstration.steps
