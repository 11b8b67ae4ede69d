"""Metadata of datasets and episodes: what is demonstrated, how much of it is proven, and the reference scores."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import minari
import numpy as np

from flatgym import __version__, observation_names
from flatgym.scenarios.catalogue import Problem
from optimal.discrete.fewest_steps import FewestSteps

ENVIRONMENT = "FlatQuad-v0"
"""The environment of demonstrations."""
Facts = dict[str, Any]
"""Metadata of an episode as Minari returns it: `episode_facts`, the seed, and the options of the reset, if any."""


def episode_facts(flight: FewestSteps, scenario: str) -> Facts:
    """Return the metadata of an episode.

    Args:
        flight: the flight.
        scenario: the scenario of the environment, as JSON text.
    """
    return {
        "k_star": len(flight.actions),
        "lower_bound": flight.lower_bound,
        "proven": flight.proven,
        "tolerance_used": flight.tolerance_used,
        "winding": flight.winding,
        "scenario": scenario,
    }


def dataset_metadata(identity: str, target: Problem, episodes: Sequence[Facts], env: gym.Env[Any, Any]) -> Facts:
    """Return the metadata of a dataset: Minari's fields, and those that `agents.demonstrations.check` reads.

    Reference scores: the minimum is minus the time limit, of a failed episode; the maximum is minus the mean time of
    the flights from the scenarios' own starts.

    Args:
        identity: Minari's id.
        target: the scenario or distribution.
        episodes: metadata of all episodes.
        env: the environment of the recording.
    """
    assert env.spec is not None
    from_start = [int(known["k_star"]) for known in episodes if "options" not in known]
    proven = sum(bool(known["proven"]) for known in episodes)
    return {
        "dataset_id": identity,
        "eval_env_spec": env.spec.to_json(),
        "algorithm_name": "optimal.fewest_steps",
        "author": {"FlatQuad"},
        "author_email": {""},
        "code_permalink": "",
        "description": (
            f"Flights of {target.name!r} in the fewest steps known, proven minimal for {proven} of {len(episodes)}; "
            f"flatgym {__version__}; reward: minus time."
        ),
        "requirements": [f"flatgym=={__version__}"],
        "minari_version": minari.__version__,
        "ref_min_score": -target.time_limit,
        "ref_max_score": -target.dt * float(np.mean(from_start or [int(known["k_star"]) for known in episodes])),
        "num_episodes_average_score": len(from_start or episodes),
        "proven_share": proven / len(episodes),
        "flatgym_version": __version__,
        "observation_names": list(observation_names()),
        "problem": target.to_json(),
    }
