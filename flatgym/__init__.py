"""FlatQuad: time-optimal planar quadrotor flight as a Gymnasium benchmark with a known optimum."""

import gymnasium as gym

from flatgym.quadrotor import Quadrotor
from flatgym.scenarios.catalogue import SCENARIOS, scenario
from flatgym.scenarios.distributions import DISTRIBUTIONS, Distribution
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.reference import Reference, reference
from flatgym.scenarios.scenario import Hoop, Scenario, Tolerance
from flatgym.task.observation import OBSERVATION_NAMES, observation_names
from flatgym.task.scene import OUTCOMES

__all__ = [
    "DISTRIBUTIONS",
    "OBSERVATION_NAMES",
    "OUTCOMES",
    "SCENARIOS",
    "Distribution",
    "Disturbances",
    "Hoop",
    "Quadrotor",
    "Reference",
    "Scenario",
    "Tolerance",
    "observation_names",
    "reference",
    "scenario",
]
__version__ = "0.1.0"

gym.register(
    id="FlatQuad-v0",
    entry_point="flatgym.envs.env:FlatQuadEnv",
    vector_entry_point="flatgym.envs.vector:FlatQuadVectorEnv",
)
