"""The learners: Stable-Baselines3 on the batched environment, demonstrations, and scores against K*."""

from flatgym.extras import require

require("agents", "stable_baselines3", "torch", "minari", "pandas")

from agents import demonstrations
from agents.evaluate import FasterThanOptimal, evaluate, fly
from agents.vec_env import FlatQuadVecEnv, make_vec_env

__all__ = ["FasterThanOptimal", "FlatQuadVecEnv", "demonstrations", "evaluate", "fly", "make_vec_env"]
