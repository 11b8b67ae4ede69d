"""Algorithms of Stable-Baselines3 and sb3-contrib whose policies can be loaded, and how a zip shows which one it holds.

A zip does not name its algorithm, and the class of the policy may be the user's own. The settings of the algorithm are
there in plain text, and each algorithm has some that no other has.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm

ALGORITHMS = {
    "PPO": "stable_baselines3",
    "A2C": "stable_baselines3",
    "SAC": "stable_baselines3",
    "TD3": "stable_baselines3",
    "DDPG": "stable_baselines3",
    "TQC": "sb3_contrib",
    "CrossQ": "sb3_contrib",
    "TRPO": "sb3_contrib",
    "ARS": "sb3_contrib",
    "RecurrentPPO": "sb3_contrib",
    "DQN": "stable_baselines3",
    "QRDQN": "sb3_contrib",
}
"""Package of each algorithm; the last two have numbered actions, see `flatgym.envs.levels`."""
SETTINGS = (
    ("TQC", {"top_quantiles_to_drop_per_net"}),
    ("TRPO", {"cg_damping"}),
    ("ARS", {"delta_std_schedule"}),
    ("TD3", {"target_policy_noise"}),
    ("CrossQ", {"target_entropy", "policy_delay"}),
    ("SAC", {"target_entropy"}),
    ("QRDQN", {"n_quantiles"}),
    ("DQN", {"exploration_initial_eps"}),
    ("PPO", {"clip_range"}),
    ("A2C", {"gae_lambda"}),
)
"""Settings that a zip of an algorithm has, and that of none further down."""
DDPG_SETTINGS = {"policy_delay": 1, "target_noise_clip": 0.0}
"""Settings by which Stable-Baselines3 makes a TD3 a DDPG."""
RECURRENT_WEIGHTS = b"lstm_actor."
"""Beginning of the names of weights that only a recurrent policy has."""


def algorithm(name: str) -> type[BaseAlgorithm]:
    """Return an algorithm's class; a ValueError for an unknown name."""
    if name not in ALGORITHMS:
        raise ValueError(f"unknown algorithm {name!r}; known: {', '.join(ALGORITHMS)}")
    found: type[BaseAlgorithm] = getattr(import_module(ALGORITHMS[name]), name)
    return found


def recognise(settings: Mapping[str, Any], weights: bytes = b"") -> str:
    """Return the name of the algorithm that wrote a zip, "" if it is none of ALGORITHMS.

    Args:
        settings: the zip's member "data".
        weights: the zip's member "policy.pth"; a search for the names of its weights tells a RecurrentPPO from a PPO.
    """
    name = next((name for name, own in SETTINGS if own <= settings.keys()), "")
    if name == "TD3" and all(settings.get(key) == value for key, value in DDPG_SETTINGS.items()):
        return "DDPG"
    return "RecurrentPPO" if name == "PPO" and RECURRENT_WEIGHTS in weights else name
