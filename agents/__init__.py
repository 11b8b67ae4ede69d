"""The learners: Stable-Baselines3 on the batched environment, experts, imitation, demonstrations, scores against K*."""

from flatgym.extras import require

require("agents", "stable_baselines3", "sb3_contrib", "torch", "minari", "pandas")

from agents import demonstrations, imitation, policies
from agents.advice import guided, regulated
from agents.cascade import Cascade
from agents.configs import CONFIGS, Config, PPOConfig, SACConfig, TD3Config, TQCConfig, config_of
from agents.evaluate import FasterThanOptimal, Flights, evaluate, flight_rows, fly
from agents.experts import Expert, Tape
from agents.intervals import summary
from agents.replanner import Replanner
from agents.seen import relative_state
from agents.starts import backward_starts
from agents.train import Training, build, train
from agents.vec_env import FlatQuadVecEnv, make_vec_env

__all__ = [
    "CONFIGS",
    "Cascade",
    "Config",
    "Expert",
    "FasterThanOptimal",
    "FlatQuadVecEnv",
    "Flights",
    "PPOConfig",
    "Replanner",
    "SACConfig",
    "TD3Config",
    "TQCConfig",
    "Tape",
    "Training",
    "backward_starts",
    "build",
    "config_of",
    "demonstrations",
    "evaluate",
    "flight_rows",
    "fly",
    "guided",
    "imitation",
    "make_vec_env",
    "policies",
    "regulated",
    "relative_state",
    "summary",
    "train",
]
