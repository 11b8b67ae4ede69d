"""The learners: Stable-Baselines3 on the batched environment, demonstrations, and scores against K*."""

from flatgym.extras import require

require("agents", "stable_baselines3", "sb3_contrib", "torch", "minari", "pandas")

from agents import demonstrations
from agents.configs import PPOConfig
from agents.evaluate import FasterThanOptimal, evaluate, fly
from agents.starts import backward_starts
from agents.train import Training, train
from agents.vec_env import FlatQuadVecEnv, make_vec_env

__all__ = [
    "FasterThanOptimal",
    "FlatQuadVecEnv",
    "PPOConfig",
    "Training",
    "backward_starts",
    "demonstrations",
    "evaluate",
    "fly",
    "make_vec_env",
    "train",
]
