"""Agents: Stable-Baselines3 training, classical controllers, demonstrations, imitation learning, scores against K*."""

from flatgym.extras import require

require("agents", "stable_baselines3", "sb3_contrib", "torch", "minari", "pandas")

from agents import demonstrations, imitation, policies
from agents.controllers.cascaded_pd import CascadedPD
from agents.controllers.mpc import MPC
from agents.controllers.tracking import Expert, OpenLoop
from agents.controllers.trivial import Hover, RandomActions
from agents.evaluation.bootstrap import summary
from agents.evaluation.rollouts import Episodes, fly
from agents.evaluation.scores import FasterThanOptimal, episode_rows, evaluate
from agents.imitation.oracles import combined_oracle, lqr_oracle
from agents.training.backward_starts import backward_starts
from agents.training.configs import (
    CONFIGS,
    Config,
    CrossQConfig,
    DQNConfig,
    PPOConfig,
    QRDQNConfig,
    SACConfig,
    TD3Config,
    TQCConfig,
    config_of,
)
from agents.training.models import build
from agents.training.progress_reward import ProgressReward
from agents.training.train import Training, train
from agents.training.vec_env import FlatQuadVecEnv, make_vec_env
from flatgym.task.observation import decode_observation

__all__ = [
    "CONFIGS",
    "MPC",
    "CascadedPD",
    "Config",
    "CrossQConfig",
    "DQNConfig",
    "Episodes",
    "Expert",
    "FasterThanOptimal",
    "FlatQuadVecEnv",
    "Hover",
    "OpenLoop",
    "PPOConfig",
    "ProgressReward",
    "QRDQNConfig",
    "RandomActions",
    "SACConfig",
    "TD3Config",
    "TQCConfig",
    "Training",
    "backward_starts",
    "build",
    "combined_oracle",
    "config_of",
    "decode_observation",
    "demonstrations",
    "episode_rows",
    "evaluate",
    "fly",
    "imitation",
    "lqr_oracle",
    "make_vec_env",
    "policies",
    "summary",
    "train",
]
