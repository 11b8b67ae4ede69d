"""Training configurations: one flat dataclass for each algorithm, with a sentence for each field.

PPOConfig(scenario="hoop", seed=1);  config.to_json();  from_json(text)
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar

from agents.training.fields import (
    Bins,
    Checked,
    Count,
    Factor,
    Levels,
    Natural,
    NonNegative,
    Positive,
    Real,
    Seed,
    Share,
    Turns,
)
from flatgym.validation import choice

TOLERANCE_SHARE = 0.4
"""Share of the training after which the tolerance is the true one."""


@dataclass(frozen=True)
class Config(Checked):
    """Fields that all algorithms share."""

    algorithm: ClassVar[str] = ""
    """Name of the algorithm."""
    rollout_field: ClassVar[str] = "train_freq"
    """Field with the steps of each vehicle between two updates."""

    seed: Seed = 0
    """Seed of start states, initial weights and exploration."""
    max_seconds: Positive = 250.0
    """Wall time after which training stops [s]. On a machine too slow for `env_steps` in this time, the schedules run
    over the wall time instead."""
    env_steps: Count = 5_000_000
    """Environment steps after which training stops; all schedules run over them."""
    folder: str = "runs"
    """Folder of model, configuration, learning curve and checkpoint."""
    num_envs: Count = 256
    """Vehicles simulated in parallel."""
    batch_size: Count = 4096
    """Rows of a minibatch."""
    width: Count = 64
    """Units of each hidden layer of the actor."""
    depth: Count = 2
    """Hidden layers of actor and critic."""
    value_width: Natural = 0
    """Units of each hidden layer of the critic; 0 for as many as the actor's."""
    observation_scale: Positive = 3.0
    """Scale of all observations except the attitude at the input of the network."""
    guidance: bool = False
    """Whether guidance features replace the time in the observations; see `agents.policies.guidance`."""
    learning_rate: Positive = 1e-3
    """Learning rate, initial if it is adapted."""
    gamma: Share = 0.98
    """Initial discount."""
    gamma_end: Share = 0.995
    """Discount after three fifths of the training."""
    policy: str = ""
    """Policy to start from, network included: a zip that you trust, or the name of a pretrained policy."""
    tolerance: Factor = 3.0
    """Initial factor on the tolerance; it falls to 1 by TOLERANCE_SHARE of the training."""
    pool_share: Share = 0.8
    """Share of episodes that start from the pool of start states until the tolerance is the true one; distributions
    have no pool."""
    pool_share_end: Share = 0.1
    """The same share at the end of the training."""
    pool_near_share: Share = 0.125
    """Share of the pool sampled around the goal; the rest is simulated backwards from the goal."""
    max_back_time: Positive = 1.0
    """Longest time of the backward simulation [s]."""
    pool_expert_share: Share = 0.0
    """Share of the pool replaced by states of an optimal (K*) episode: near the goal at first, anywhere on it by
    TOLERANCE_SHARE of the training."""
    failure_cost: NonNegative = 0.5
    """Cost of a failed episode in training [s], for each hoop still ahead, but at least once; see
    `agents.training.curriculum.TrainingReward`."""
    turns: Turns = None
    """Whole turns of the tilt with which a training episode must reach the goal, positive ones to the right; with any
    other number it fails. None for any."""
    eval_every: Count = 2
    """Rollouts between two validations of the deterministic policy."""
    n_eval_episodes: Count = 64
    """Validation episodes on a distribution, the same each time; a scenario needs one, because it is deterministic."""
    checkpoint_every: Count = 50
    """Rollouts between two checkpoints (a segment); each segment resets all episodes."""
    tensorboard: str = ""
    """Folder of TensorBoard files, with a subfolder for each training; none are written if empty."""

    @property
    def rollout_steps(self) -> int:
        """Steps of each vehicle between two updates: `n_steps` on-policy, `train_freq` off-policy."""
        return int(getattr(self, self.rollout_field))

    def to_json(self) -> str:
        """Return the configuration as JSON text; `from_json` is the inverse."""
        return json.dumps({"algorithm": self.algorithm, **asdict(self)}, indent=1)


@dataclass(frozen=True)
class PPOConfig(Config):
    """Proximal policy optimisation (Schulman et al. 2017), its learning rate adapted to a target divergence."""

    algorithm: ClassVar[str] = "PPO"
    rollout_field: ClassVar[str] = "n_steps"

    folder: str = "runs/ppo"
    n_steps: Count = 64
    """Steps of each vehicle between two updates (a rollout)."""
    n_epochs: Count = 6
    """Epochs over a rollout."""
    bins: Bins = (2, 21)
    """Bins of thrust and rate of a categorical actor, see `agents.policies.categorical`; None for a Gaussian one. A
    policy to start from keeps its own."""
    log_std_init: Real = -0.7
    """Initial logarithm of the standard deviation of a Gaussian actor."""
    learning_rate_max: Positive = 2e-2
    """Largest learning rate."""
    target_kl: Positive = 0.03
    """Initial target of the Kullback-Leibler divergence of an update; it falls linearly."""
    target_kl_end: Share = 0.02
    """Share of the initial target at the end of the training."""
    gae_lambda: Share = 0.95
    """Lambda of generalised advantage estimation."""
    ent_coef: NonNegative = 0.0
    """Initial weight of the entropy in the loss; it falls linearly to 0. Advantages are normalised."""
    self_imitation: Natural = 8
    """Gradient steps of self-imitation between two rollouts, see `agents.training.self_imitation`; 0 for none.
    Distributions have none, because each of their episodes has a start of its own."""
    value_warmup: Natural = 10
    """Initial rollouts that train the critic only, to preserve the policy to start from; without one, none."""


@dataclass(frozen=True)
class OffPolicyConfig(Config):
    """Fields that the algorithms with a replay buffer share.

    Rewards in the buffer belong to the tolerance at their time. The buffer is short enough to drop those of wider
    tolerances by two thirds of the training.
    """

    max_seconds: Positive = 900.0
    env_steps: Count = 500_000
    num_envs: Count = 64
    train_freq: Count = 1
    """Steps of each vehicle between two updates (a rollout)."""
    batch_size: Count = 256
    eval_every: Count = 125
    checkpoint_every: Count = 1_250
    gradient_steps: Count = 8
    """Gradient steps after a rollout."""
    n_steps: Count = 5
    """Steps of the n-step return. With 1 the value of the goal spreads by one step of an episode in each update."""
    buffer_size: Count = 120_000
    """Capacity of the replay buffer [steps]."""
    learning_starts: Natural = 10_000
    """Random environment steps before the first update; none with a policy to start from."""
    learning_rate_end: Share = 1.0
    """Share of the initial learning rate at the end of the training; it falls linearly."""


@dataclass(frozen=True)
class SoftConfig(OffPolicyConfig):
    """Fields that the algorithms with an entropy bonus share."""

    ent_coef: Positive = 0.01
    """Initial entropy coefficient; it is learnt."""
    log_std_init: Real = -1.0
    """Initial logarithm of the exploration's standard deviation, before tanh."""


@dataclass(frozen=True)
class SACConfig(SoftConfig):
    """Soft actor-critic (Haarnoja et al. 2018)."""

    algorithm: ClassVar[str] = "SAC"

    folder: str = "runs/sac"
    tau: Share = 0.005
    """Soft update coefficient of the target network."""


@dataclass(frozen=True)
class TD3Config(OffPolicyConfig):
    """Twin delayed deterministic policy gradients (Fujimoto et al. 2018)."""

    algorithm: ClassVar[str] = "TD3"

    folder: str = "runs/td3"
    tau: Share = 0.005
    """Soft update coefficient of the target network."""
    action_noise_std: NonNegative = 0.2
    """Standard deviation of the exploration noise on the action."""


@dataclass(frozen=True)
class TQCConfig(SACConfig):
    """Truncated quantile critics (Kuznetsov et al. 2020): SAC on quantiles of the return, the highest dropped."""

    algorithm: ClassVar[str] = "TQC"

    folder: str = "runs/tqc"
    top_quantiles_to_drop_per_net: Natural = 2
    """Quantiles dropped from each critic."""


@dataclass(frozen=True)
class CrossQConfig(SoftConfig):
    """CrossQ (Bhatt et al. 2024): SAC without target networks, its critics with batch normalisation."""

    algorithm: ClassVar[str] = "CrossQ"

    folder: str = "runs/crossq"


@dataclass(frozen=True)
class DQNConfig(OffPolicyConfig):
    """Deep Q-network (Mnih et al. 2015) over numbered actions, see `flatgym.envs.levels`.

    Exploration has a constant rate, because most episodes start near the goal.
    """

    algorithm: ClassVar[str] = "DQN"

    folder: str = "runs/dqn"
    env_steps: Count = 1_000_000
    guidance: bool = True
    gamma_end: Share = 0.99
    width: Count = 128
    batch_size: Count = 512
    n_steps: Count = 10
    buffer_size: Count = 400_000
    eval_every: Count = 50  # the greedy policy varies much between updates, and the best one is kept
    bins: Levels = (2, 11)
    """Levels of thrust and rate; each combination is an action."""
    learning_rate_end: Share = 0.05
    exploration_rate: Share = 0.05
    """Share of steps with random actions."""
    target_update_interval: Count = 2_000
    """Environment steps between two updates of the target network."""


@dataclass(frozen=True)
class QRDQNConfig(DQNConfig):
    """Quantile-regression DQN (Dabney et al. 2018): DQN on quantiles of the return."""

    algorithm: ClassVar[str] = "QRDQN"

    folder: str = "runs/qrdqn"
    n_quantiles: Count = 8
    """Quantiles of the return of each action."""


KINDS: tuple[type[Config], ...] = (
    PPOConfig, SACConfig, TD3Config, TQCConfig, CrossQConfig, DQNConfig, QRDQNConfig,
)  # fmt: skip
CONFIGS: dict[str, type[Config]] = {kind.algorithm: kind for kind in KINDS}
"""Configuration class of each algorithm."""


def config_of(algorithm: str, **values: Any) -> Config:
    """Return the configuration of an algorithm; the name is case-insensitive.

    Raises:
        ValueError: for an unknown algorithm or field, listing the known ones, and for an invalid value.
    """
    kinds = {name.lower(): kind for name, kind in CONFIGS.items()}
    kind = kinds.get(algorithm.lower()) or CONFIGS[choice("algorithm", algorithm, CONFIGS)]
    known = [field.name for field in fields(kind)]
    if unknown := sorted(set(values) - set(known)):
        raise ValueError(f"unknown fields {', '.join(unknown)} of {kind.__name__}; known: {', '.join(known)}")
    return kind(**values)


def from_json(text: str) -> Config:
    """Return the configuration that `Config.to_json` wrote; missing fields take their defaults.

    Raises:
        ValueError: for text that is not a JSON object with an "algorithm", for unknown fields and invalid values.
    """
    try:
        values = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"a configuration must be a JSON text: {error}") from None
    if not isinstance(values, dict) or not isinstance(values.get("algorithm"), str):
        raise ValueError(
            f"a configuration must be a JSON object with an 'algorithm' of {', '.join(CONFIGS)}: {values!r}"
        )
    return config_of(**values)
