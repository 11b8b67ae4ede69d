"""Networks of actor and critic: input scaling, width and depth.

Stored policies pickle `ScaledObservations` by its module path; moving or renaming the class makes them unreadable.
"""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from flatgym.task.observation import OBSERVATION_NAMES


class ScaledObservations(BaseFeaturesExtractor):
    """Scales all observations except sine and cosine of the attitude, which are of order one."""

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
    observation_scale: float,
    features: type[ScaledObservations] = ScaledObservations,
) -> dict[str, Any]:
    """Return SB3's `policy_kwargs` for separate actor and critic networks.

    Args:
        critic: SB3's key of the critic: "vf" on-policy, "qf" off-policy.
        width: units of each hidden layer of the actor.
        depth: hidden layers of actor and critic.
        value_width: units of each hidden layer of the critic; 0 for as many as the actor's.
        observation_scale: factor of `ScaledObservations`.
        features: the feature extractor.
    """
    return {
        "net_arch": {"pi": [width] * depth, critic: [value_width or width] * depth},
        "activation_fn": torch.nn.ELU,
        "features_extractor_class": features,
        "features_extractor_kwargs": {"factor": observation_scale},
    }


def act(model: PPO, observations: torch.Tensor) -> torch.Tensor:
    """Return the actor's differentiable outputs for observations (n, 19): unclipped actions (n, 2), or logits."""
    policy: Any = model.policy
    return policy.action_net(policy.mlp_extractor.forward_actor(policy.pi_features_extractor(observations)))


def actor_parameters(model: PPO) -> list[torch.nn.Parameter]:
    """Return the parameters of the actor."""
    policy: Any = model.policy
    return [*policy.mlp_extractor.policy_net.parameters(), *policy.action_net.parameters()]
