"""FlatQuad: time-optimal planar quadrotor flight as a Gymnasium benchmark with a known optimum."""

import gymnasium as gym

from flatgym.catalogue import SCENARIOS, scenario
from flatgym.distributions import DISTRIBUTIONS, Distribution
from flatgym.disturbances import Disturbances
from flatgym.quadrotor import Quadrotor
from flatgym.reference import Reference, reference
from flatgym.scenario import Hoop, Scenario, Tolerance
from flatgym.scene import OUTCOMES
from flatgym.task import OBSERVATION_NAMES, observation_names

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
    entry_point="flatgym.env:FlatQuadEnv",
    vector_entry_point="flatgym.vector:FlatQuadVectorEnv",
)
