"""Recording: flights flown through the real environment and kept as a Minari dataset, whole or not at all.

What is stored is what the environment said while the actions were flown, and only a flight that ends in the outcome
"goal" at its K-th step is stored. Each episode tells how to begin it again, so that it can be flown anew:

    env = dataset.recover_environment()
    env.reset(seed=seed, options=options)

Beside observations, actions and rewards an episode holds the states, in `infos["state"]`, and as metadata k_star,
lower_bound, proven, tolerance_used, winding and the scenario.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import gymnasium as gym
import minari
import numpy as np
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_storage import MinariStorage

from agents.demonstrations.storage import atomic_dataset, dataset_id
from flatgym import __version__, observation_names
from flatgym.scenarios.catalogue import SCENARIOS, Problem, ProblemLike
from flatgym.scenarios.catalogue import problem as problem_named
from flatgym.scenarios.distributions import DISTRIBUTIONS
from flatgym.scenarios.scenario import Scenario
from optimal.discrete.fewest_steps import FewestSteps

ENVIRONMENT = "FlatQuad-v0"
"""The environment that demonstrations are flown in."""
BATCH = 100
"""Episodes that are flown before they are written."""

Progress = Callable[[int, int], Any]
"""Called with how many are done and how many there are."""


def no_progress(*counts: int) -> None:
    """Tell nobody how far the work is."""


@dataclass(frozen=True)
class Demonstration:
    """A flight to record, and how the environment begins it.

    Attributes:
        scenario: what the environment flies.
        flight: the flight; it may begin elsewhere than the scenario.
        seed: of the environment's reset.
        hoops_passed: hoops that count as passed when it begins.
    """

    scenario: Scenario
    flight: FewestSteps
    seed: int = 0
    hoops_passed: int = 0

    @property
    def steps(self) -> int:
        """Steps to the goal from where the flight begins."""
        return len(self.flight.actions)

    @property
    def options(self) -> dict[str, Any] | None:
        """Options of the environment's reset; None for the scenario's own start."""
        state = self.flight.states[0]
        if not self.hoops_passed and np.array_equal(state, self.scenario.start_state):
            return None
        return {"state": state, "hoops_passed": self.hoops_passed}


@dataclass(frozen=True)
class Replay:
    """How a stored episode ended when it was flown anew: outcome, steps, and the K that was stored with it."""

    outcome: str
    steps: int
    k_star: int


def record(
    problem: ProblemLike,
    demonstrations: Sequence[Demonstration],
    name: str | None = None,
    *,
    progress: Progress = no_progress,
) -> minari.MinariDataset:
    """Fly the demonstrations in the environment and store them, in place of an older dataset of that name.

    Args:
        problem: what the environment is made with: a scenario, or the distribution from which all of them are.
        demonstrations: flights of this problem.
        name: Minari's dataset id; by default `dataset_id(problem)`.
        progress: called with how many are recorded and how many there are.

    Raises:
        ValueError: for no demonstrations, or a distribution without a name.
        RuntimeError: when a flight does not end in the outcome "goal" at its K-th step.
        OSError: when the dataset cannot be written; an older one is as it was, after this as after the other errors.
    """
    target, identity = problem_named(problem), dataset_id(problem, name)
    if not demonstrations:
        raise ValueError(f"no demonstrations of {target.name!r} to record")
    env = gym.make(ENVIRONMENT, scenario=_plain(target), reward="sparse")
    with atomic_dataset(identity, sum(map(_size, demonstrations))) as folder:
        storage = MinariStorage.new(folder, env_spec=env.spec)
        for begin in range(0, len(demonstrations), BATCH):
            batch = demonstrations[begin : begin + BATCH]
            storage.update_episodes([_fly(env, demonstration) for demonstration in batch])
            progress(begin + len(batch), len(demonstrations))
        storage.update_episode_metadata([_facts(demonstration) for demonstration in demonstrations])
        storage.update_metadata(_metadata(identity, target, demonstrations, env))
    env.close()
    return minari.load_dataset(identity)


def replay(dataset: minari.MinariDataset) -> list[Replay]:
    """Fly every stored episode anew in the recovered environment; all must end in "goal" after K steps."""
    env, replays = dataset.recover_environment(), []
    facts = dataset.storage.get_episode_metadata(dataset.episode_indices)
    for episode, known in zip(dataset.iterate_episodes(), facts, strict=True):
        _, info = env.reset(seed=known["seed"], options=known.get("options"))
        for action in episode.actions:
            info = env.step(action)[4]
            if info["outcome"] != "flying":
                break
        replays.append(Replay(info["outcome"], info["steps"], int(known["k_star"])))
    env.close()
    return replays


def check(dataset: minari.MinariDataset, problem: ProblemLike, observation: str = "features") -> None:
    """Refuse a dataset of another environment, of another scenario, or of other observations.

    Args:
        dataset: as Minari loads it.
        problem: what it is to demonstrate.
        observation: what the learner sees, "features" or "state".

    Raises:
        ValueError: naming what the dataset is of and what was wanted.
    """
    metadata, spec, target = dataset.storage.metadata, dataset.env_spec, problem_named(problem)
    flown = "no environment" if spec is None else spec.id
    if flown != ENVIRONMENT:
        raise ValueError(f"dataset {dataset.id!r} is of {flown}, wanted one of {ENVIRONMENT}; record it anew")
    if "problem" not in metadata:
        raise ValueError(
            f"dataset {dataset.id!r} does not tell its scenario; wanted one that `flatquad demos` recorded"
        )
    names, wanted = metadata["observation_names"], list(observation_names(observation))
    if names != wanted:
        raise ValueError(
            f"dataset {dataset.id!r} of flatgym {metadata['flatgym_version']} holds the observations "
            f"{', '.join(names)}; flatgym {__version__} has {', '.join(wanted)} as {observation!r}; record it anew"
        )
    kept, here = json.loads(metadata["problem"]), _fields(target)
    if kept != here:
        unlike = [key for key in kept.keys() | here.keys() if kept.get(key) != here.get(key)]
        of = f"{kept.get('name')!r}, wanted {target.name!r}; they differ in "
        each = "; ".join(f"{key}: {kept.get(key)} and {here.get(key)}" for key in sorted(unlike))
        raise ValueError(f"dataset {dataset.id!r} is of {of}{each}")


def _plain(target: Problem) -> str:
    """Return a problem as an environment specification can hold it: a name, or a scenario's JSON text."""
    if isinstance(target, Scenario):
        return target.name if SCENARIOS.get(target.name) == target else target.to_json()
    if DISTRIBUTIONS.get(target.name) != target:
        raise ValueError(
            f"a dataset cannot hold the distribution {target.name!r}; named ones: {', '.join(DISTRIBUTIONS)}"
        )
    return target.name


def _fields(target: Problem) -> dict[str, Any]:
    return json.loads(json.dumps(asdict(target)))


def _fly(env: gym.Env[Any, Any], demonstration: Demonstration) -> EpisodeBuffer:
    """Fly a demonstration and return what the environment said.

    Raises:
        RuntimeError: where the environment flies another scenario, or the flight does not end as planned.
    """
    observation, info = env.reset(seed=demonstration.seed, options=demonstration.options)
    if env.unwrapped.scenario != demonstration.scenario:  # type: ignore[attr-defined]
        raise RuntimeError(
            f"seed {demonstration.seed} gives {env.unwrapped.scenario}, "  # type: ignore[attr-defined]
            f"not {demonstration.scenario}"
        )
    observations, states, said = [observation], [info["state"]], []
    for action in demonstration.flight.actions:
        observation, *answer, info = env.step(action)
        observations.append(observation)
        states.append(info["state"])
        said.append(answer)
        if info["outcome"] != "flying":
            break
    if info["outcome"] != "goal" or info["steps"] != demonstration.steps:
        raise RuntimeError(
            f"{demonstration.scenario.name!r}: a planned flight of {demonstration.steps} steps ended as {info}"
        )
    rewards, terminations, truncations = zip(*said, strict=True)
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
    """Return what is stored with an episode."""
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
    """Return what Minari wants to know of a dataset, and what `check` does.

    Reference scores: a flight that fails pays the time limit; the best pays its time, on the mean over the flights
    from the scenarios' own starts.
    """
    assert env.spec is not None
    whole = [one.steps for one in demonstrations if one.options is None]
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
        "ref_max_score": -target.dt * float(np.mean(whole or [one.steps for one in demonstrations])),
        "num_episodes_average_score": len(whole or demonstrations),
        "flatgym_version": __version__,
        "observation_names": list(observation_names()),
        "problem": json.dumps(_fields(target)),
    }


def _size(demonstration: Demonstration) -> int:
    """Return more than what an episode takes on disk [bytes]."""
    return 32_000 + 300 * demonstration.steps
