"""The networks of actor and critic: what they see, and how wide and deep they are.

Saved policies name the module of `ScaledObservations`: it cannot move without orphaning them.
"""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from flatgym.task.observation import OBSERVATION_NAMES


class ScaledObservations(BaseFeaturesExtractor):
    """Multiplies all observations but sine and cosine of the attitude, which are of order one already."""

    def __init__(self, observation_space: Any, factor: float) -> None:
        super().__init__(observation_space, len(OBSERVATION_NAMES))
        scale = [1.0 if name.endswith("theta") else factor for name in OBSERVATION_NAMES]
        self.scale: torch.Tensor
        self.register_buffer("scale", torch.tensor(scale))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the scaled observations, shape (n, 19)."""
        return observations * self.scale


def network(
    critic: str,
    width: int,
    depth: int,
    value_width: int,
    zoom: float,
    features: type[ScaledObservations] = ScaledObservations,
) -> dict[str, Any]:
    """Return SB3's `policy_kwargs` of an actor and a critic that share nothing but what they see.

    Args:
        critic: what SB3 calls the critic: "vf" on policy, "qf" off policy.
        width: units of each hidden layer of the actor.
        depth: hidden layers of either.
        value_width: units of each hidden layer of the critic; 0 for as many as the actor's.
        zoom: factor of `ScaledObservations`.
        features: what is made of the observations.
    """
    return {
        "net_arch": {"pi": [width] * depth, critic: [value_width or width] * depth},
        "activation_fn": torch.nn.ELU,
        "features_extractor_class": features,
        "features_extractor_kwargs": {"factor": zoom},
    }


def act(model: PPO, observations: torch.Tensor) -> torch.Tensor:
    """Return the actor's outputs (n, 2) for observations (n, 19), yet to be clipped, differentiably."""
    policy: Any = model.policy
    return policy.action_net(policy.mlp_extractor.forward_actor(policy.pi_features_extractor(observations)))


def actor_parameters(model: PPO) -> list[torch.nn.Parameter]:
    """Return the weights of the actor."""
    policy: Any = model.policy
    return [*policy.mlp_extractor.policy_net.parameters(), *policy.action_net.parameters()]
