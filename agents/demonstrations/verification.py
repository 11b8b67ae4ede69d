"""Verification of recorded datasets: their replay, and whether they fit a problem."""

from __future__ import annotations

import json
from dataclasses import dataclass

import minari

from agents.demonstrations.metadata import ENVIRONMENT
from flatgym import __version__, observation_names
from flatgym.scenarios.catalogue import ProblemLike
from flatgym.scenarios.catalogue import problem as problem_named


@dataclass(frozen=True)
class Replay:
    """Result of a replayed episode: its outcome, its steps, and the stored K*."""

    outcome: str
    steps: int
    k_star: int


def replay(dataset: minari.MinariDataset) -> list[Replay]:
    """Replay every episode in the recovered environment; in a valid dataset each reaches "goal" after K* steps."""
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
    """Refuse a dataset of another environment, another scenario, or other observations.

    Args:
        dataset: the dataset, as Minari loads it.
        problem: the scenario or distribution it must demonstrate.
        observation: observations of the policy, "features" or "state".

    Raises:
        ValueError: naming the dataset's content and the wanted one.
    """
    metadata, spec, target = dataset.storage.metadata, dataset.env_spec, problem_named(problem)
    environment = "no environment" if spec is None else spec.id
    if environment != ENVIRONMENT:
        raise ValueError(f"dataset {dataset.id!r} is of {environment}, wanted one of {ENVIRONMENT}; record it again")
    if "problem" not in metadata:
        raise ValueError(f"dataset {dataset.id!r} names no scenario; wanted one that `flatquad demos` recorded")
    names, wanted = metadata["observation_names"], list(observation_names(observation))
    if names != wanted:
        raise ValueError(
            f"dataset {dataset.id!r} of flatgym {metadata['flatgym_version']} holds the observations "
            f"{', '.join(names)}; flatgym {__version__} has {', '.join(wanted)} as {observation!r}; record it again"
        )
    stored, here = json.loads(metadata["problem"]), target.to_dict()
    unlike = [key for key in stored.keys() | here.keys() if key != "name" and stored.get(key) != here.get(key)]
    if unlike:
        of = f"{stored.get('name')!r}, wanted {target.name!r}; they differ in "
        each = "; ".join(f"{key}: {stored.get(key)} and {here.get(key)}" for key in sorted(unlike))
        raise ValueError(f"dataset {dataset.id!r} is of {of}{each}")
