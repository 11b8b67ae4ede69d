"""What a training depends on: one flat dataclass for each algorithm, a sentence for each field.

PPOConfig(scenario="hoop", seed=1);  config.to_json();  from_json(text)
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar

from agents.training.fields import Checked, Count, Factor, Natural, NonNegative, Positive, Real, Seed, Share

TIGHT = 0.4
"""Share of the steps after which the tolerance is the true one."""


@dataclass(frozen=True)
class Config(Checked):
    """What all algorithms have in common."""

    algorithm: ClassVar[str] = ""
    """Name of the algorithm."""
    rollout_field: ClassVar[str] = "train_freq"
    """Field that holds the steps of each vehicle between two updates."""

    seed: Seed = 0
    """Seed of starts, network and exploration."""
    max_seconds: Positive = 250.0
    """Wall time after which training stops [s]; on a machine so slow that this would come first, the schedules
    run over it instead of over `env_steps`."""
    env_steps: Count = 5_000_000
    """Environment steps over which all schedules run, and after which training stops."""
    folder: str = "runs"
    """Where model, configuration, learning curve and checkpoint are written."""
    num_envs: Count = 256
    """Vehicles flown at once."""
    batch_size: Count = 4096
    """Size of a minibatch."""
    width: Count = 64
    """Units of each hidden layer of the actor."""
    depth: Count = 2
    """Hidden layers of actor and critic."""
    value_width: Natural = 0
    """Units of each hidden layer of the critic; 0 for as many as the actor's."""
    observation_scale: Positive = 3.0
    """Factor on all observations but the attitude, before the network."""
    guidance: bool = False
    """Whether the network sees what guidance laws steer by as well, and not the time; see `agents.policies.guidance`."""
    learning_rate: Positive = 1e-3
    """Learning rate, of the first update where it changes."""
    gamma: Share = 0.98
    """Discount at the beginning."""
    gamma_end: Share = 0.995
    """Discount after three fifths of the steps."""
    policy: str = ""
    """A policy to start from, its network as it is: a zip, trusted to be your own, or the name of a pretrained one."""
    tolerance: Factor = 3.0
    """Factor on the tolerance at the beginning, falling to 1 by TIGHT of the steps."""
    pool_share: Share = 0.8
    """Share of flights that begin elsewhere than at the start, until the tolerance is the true one; those of a
    distribution begin at the start always."""
    pool_share_end: Share = 0.1
    """The same share at the end."""
    pool_near_share: Share = 0.125
    """Share of these that begin around the goal; the others at states flown backwards from it."""
    max_back_time: Positive = 1.0
    """Longest time flown backwards [s]."""
    pool_expert_share: Share = 0.0
    """Share of these that begin on a flight in K* steps instead: first close to the goal, anywhere on it by TIGHT of
    the steps."""
    failure_cost: NonNegative = 0.5
    """What a failed flight costs in training [s]; the environment's own charge, the rest of the time
    limit, frightens a beginner away from the goal."""
    eval_every: Count = 5
    """Rollouts between two checks of the deterministic policy."""
    n_eval_episodes: Count = 64
    """Flights of a check on a distribution, the same each time; on a scenario one tells all."""
    checkpoint_every: Count = 50
    """Rollouts between two checkpoints; all flights begin anew then, with or without a resume."""
    tensorboard: bool = False
    """Whether to write TensorBoard's files too."""

    @property
    def rollout_steps(self) -> int:
        """Steps of each vehicle between two updates: `n_steps` on-policy, `train_freq` off-policy."""
        return int(getattr(self, self.rollout_field))

    def to_json(self) -> str:
        """Return the configuration as a JSON text that `from_json` reads."""
        return json.dumps({"algorithm": self.algorithm, **asdict(self)}, indent=1)


@dataclass(frozen=True)
class PPOConfig(Config):
    """Proximal policy optimisation (Schulman et al. 2017), its learning rate led by the divergence of the updates."""

    algorithm: ClassVar[str] = "PPO"
    rollout_field: ClassVar[str] = "n_steps"

    folder: str = "runs/ppo"
    n_steps: Count = 64
    """Steps of each vehicle between two updates (a rollout)."""
    n_epochs: Count = 6
    """Passes over a rollout."""
    log_std_init: Real = -0.7
    """Logarithm of the exploration's standard deviation at the beginning."""
    learning_rate_max: Positive = 2e-2
    """Largest learning rate."""
    target_kl: Positive = 0.03
    """Wanted Kullback-Leibler divergence of an update at the beginning, falling linearly."""
    target_kl_end: Share = 0.02
    """Share of it that is wanted at the end."""
    gae_lambda: Share = 0.95
    """Lambda of generalised advantage estimation."""
    value_warmup: Natural = 10
    """First rollouts from which only the critic learns, so as not to spoil the policy one starts from; none without."""


@dataclass(frozen=True)
class OffPolicyConfig(Config):
    """What the algorithms with a replay buffer have in common.

    What is in the buffer was judged by the tolerance of its time, so the buffer is short enough to have forgotten the
    easier ones when two thirds of the steps are over.
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
    buffer_size: Count = 120_000
    """Steps that the replay buffer holds."""
    learning_starts: Natural = 10_000
    """Environment steps flown at random before learning begins; none where there is a policy to start from."""
    tau: Share = 0.005
    """Share by which the target network follows the critic at each gradient step."""


@dataclass(frozen=True)
class SACConfig(OffPolicyConfig):
    """Soft actor-critic (Haarnoja et al. 2018), its entropy coefficient learned."""

    algorithm: ClassVar[str] = "SAC"

    folder: str = "runs/sac"
    ent_coef: Positive = 0.01
    """Entropy coefficient at the beginning."""


@dataclass(frozen=True)
class TD3Config(OffPolicyConfig):
    """Twin delayed deterministic policy gradients (Fujimoto et al. 2018)."""

    algorithm: ClassVar[str] = "TD3"

    folder: str = "runs/td3"
    action_noise_std: NonNegative = 0.2
    """Standard deviation of the exploration's noise on the action."""


@dataclass(frozen=True)
class TQCConfig(SACConfig):
    """Truncated quantile critics (Kuznetsov et al. 2020): SAC on quantiles of the return, the highest cut off."""

    algorithm: ClassVar[str] = "TQC"

    folder: str = "runs/tqc"
    top_quantiles_to_drop_per_net: Natural = 2
    """Quantiles cut off from each critic."""


CONFIGS: dict[str, type[Config]] = {kind.algorithm: kind for kind in (PPOConfig, SACConfig, TD3Config, TQCConfig)}
"""The configurations by the name of their algorithm."""


def config_of(algorithm: str, **values: Any) -> Config:
    """Return the configuration of an algorithm, by its name in any letters.

    Raises:
        ValueError: for an unknown algorithm or field, listing the known ones, and for a bad value.
    """
    kind = CONFIGS.get(algorithm.upper())
    if kind is None:
        raise ValueError(f"unknown algorithm {algorithm!r}; known: {', '.join(CONFIGS)}")
    known = [field.name for field in fields(kind)]
    if unknown := sorted(set(values) - set(known)):
        raise ValueError(f"unknown fields {', '.join(unknown)} of {kind.__name__}; known: {', '.join(known)}")
    return kind(**values)


def from_json(text: str) -> Config:
    """Return what `Config.to_json` wrote; fields that are missing have their defaults.

    Raises:
        ValueError: for what is no JSON object with an "algorithm", for unknown fields and bad values.
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
