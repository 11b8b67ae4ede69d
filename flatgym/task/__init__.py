"""The task as pure functions over batches of episodes: initial, advance, observe, reward, open-loop rollouts."""

from flatgym.task.observation import OBSERVATION_NAMES, OBSERVATIONS, observation_names, observe
from flatgym.task.rewards import reward
from flatgym.task.rollout import fly_actions
from flatgym.task.transition import advance, initial, passage

__all__ = [
    "OBSERVATIONS",
    "OBSERVATION_NAMES",
    "advance",
    "fly_actions",
    "initial",
    "observation_names",
    "observe",
    "passage",
    "reward",
]
