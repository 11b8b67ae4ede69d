"""Models: the Stable-Baselines3 model of a configuration, with its environments.

build(PPOConfig(scenario="hoop")).learn(100_000)
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, overload

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.vec_env import VecEnv

from agents import policies
from agents.policies.algorithms import algorithm
from agents.policies.categorical import CategoricalPolicy
from agents.policies.guidance import Guidance
from agents.policies.networks import ScaledObservations, network
from agents.training.configs import (
    Config,
    CrossQConfig,
    DQNConfig,
    OffPolicyConfig,
    PPOConfig,
    QRDQNConfig,
    SoftConfig,
    TD3Config,
    TQCConfig,
)
from agents.training.curriculum import TrainingReward, curriculum
from agents.training.vec_env import NumberedActions, make_vec_env
from flatgym.envs.levels import Levels


@overload
def build(config: PPOConfig) -> PPO: ...
@overload
def build(config: Config) -> BaseAlgorithm: ...
def build(config: Config) -> BaseAlgorithm:
    """Return a model with its environments: untrained, or with the network of the configured policy.

    Raises:
        ValueError: if the policy to start from is not found or belongs to another algorithm.
    """
    start = starting_policy(config)
    kind: Callable[..., BaseAlgorithm] = algorithm(config.algorithm)
    if start is not None:
        arguments = dict(start.policy_kwargs)
    else:
        critic = "vf" if isinstance(config, PPOConfig) else "qf"
        features = Guidance if config.guidance else ScaledObservations
        arguments = network(critic, config.width, config.depth, config.value_width, config.observation_scale, features)
    actor: str | type[BasePolicy] = "MlpPolicy" if start is None else start.policy_class
    if isinstance(config, PPOConfig):
        if start is None and config.bins is not None:
            actor, arguments["bins"] = CategoricalPolicy, config.bins
        arguments["log_std_init"] = config.log_std_init
    vec_env = environments(config)
    if isinstance(config, DQNConfig):
        vec_env = NumberedActions(vec_env, Levels(config.bins))
        if start is None:
            arguments["net_arch"] = arguments["net_arch"]["qf"]  # there is no actor
            del arguments["activation_fn"]  # ReLU, as in the paper of DQN
            if isinstance(config, QRDQNConfig):
                arguments["n_quantiles"] = config.n_quantiles
    model = kind(
        actor,
        vec_env,
        learning_rate=config.learning_rate,
        batch_size=config.batch_size,
        gamma=config.gamma,
        seed=config.seed,
        device="cpu",
        policy_kwargs=arguments,
        **_own_arguments(config),
    )
    if start is not None:
        model.policy.load_state_dict(start.policy.state_dict())
    if isinstance(config, PPOConfig) and isinstance(deviation := getattr(model.policy, "log_std", None), torch.Tensor):
        torch.nn.init.constant_(deviation, config.log_std_init)  # of a Gaussian actor
    if start is None and isinstance(config, SoftConfig):
        torch.nn.init.constant_(model.policy.actor.log_std.bias, config.log_std_init)  # type: ignore
    return model


def environments(config: Config) -> VecEnv:
    """Return the training environments, with the training reward."""
    starts = curriculum(config).starts(0.0)
    vec_env = make_vec_env(config.scenario, config.num_envs, starts=starts, seed=config.seed)
    return TrainingReward(vec_env, config.failure_cost, config.turns)


def starting_policy(config: Config) -> BaseAlgorithm | None:
    """Return the policy to start from, None if there is none."""
    if not config.policy:
        return None
    if config.policy in policies.names():
        found = policies.pretrained(config.policy)
    elif Path(config.policy).exists():
        found = policies.load(config.policy, trust=True)
    else:
        raise ValueError(
            f"{type(config).__name__}.policy must be a file or one of the pretrained policies "
            f"{', '.join(policies.names()) or '(there are none)'}, got {config.policy!r}"
        )
    if type(found).__name__ != config.algorithm:
        raise ValueError(
            f"{config.policy} is a policy of {type(found).__name__}; {config.algorithm} cannot start from it"
        )
    return found


def _own_arguments(config: Config) -> dict[str, Any]:
    """Return the arguments specific to the algorithm."""
    if isinstance(config, PPOConfig):
        same = ("n_steps", "n_epochs", "gae_lambda", "ent_coef")
        return {name: getattr(config, name) for name in same}
    assert isinstance(config, OffPolicyConfig)
    arguments: dict[str, Any] = {
        "buffer_size": config.buffer_size,
        "learning_starts": 0 if config.policy else config.learning_starts,
        "train_freq": (config.train_freq, "step"),
        "gradient_steps": config.gradient_steps,
        "n_steps": config.n_steps,
    }
    if isinstance(config, DQNConfig):
        rate = config.exploration_rate
        return arguments | {
            "target_update_interval": config.target_update_interval,
            "exploration_initial_eps": rate,
            "exploration_final_eps": rate,
        }
    if not isinstance(config, CrossQConfig):
        arguments["tau"] = config.tau  # type: ignore[attr-defined]
    if isinstance(config, TD3Config):
        arguments["action_noise"] = NormalActionNoise(np.zeros(2), np.full(2, config.action_noise_std))
    if isinstance(config, SoftConfig):
        arguments["ent_coef"] = f"auto_{config.ent_coef}"
    if isinstance(config, TQCConfig):
        arguments["top_quantiles_to_drop_per_net"] = config.top_quantiles_to_drop_per_net
    return arguments
