"""Names, order and colours of the agents in tables and figures."""

from __future__ import annotations

from experiments.figures import COLOURS, FLAME, FURTHER_COLOURS, OUTLINE

NAMES = {
    "ppo": "PPO",
    "ppo-gaussian": "PPO, Gaussian",
    "sac": "SAC",
    "td3": "TD3",
    "tqc": "TQC",
    "crossq": "CrossQ",
    "dqn": "DQN",
    "qrdqn": "QR-DQN",
    "bc": "BC",
    "dagger": "DAgger",
    "bc-ppo": "BC, then PPO",
    "bc-categorical": "BC, categorical",
    "dagger-categorical": "DAgger, categorical",
    "expert": "expert",
    "mpc": "MPC",
    "expert-no-margin": "expert, no margin",
    "open-loop": "open-loop replay",
    "pd": "cascaded PD",
    "hover": "hover",
    "random": "random actions",
    "pretrained": "pretrained",
}
"""Display names, in the order of the tables."""
_LEARNERS = (
    "ppo",
    "sac",
    "bc",
    "dagger",
    "bc-ppo",
    "ppo-gaussian",
    "td3",
    "tqc",
    "crossq",
    "bc-categorical",
    "dagger-categorical",
    "dqn",
    "qrdqn",
)
LEARNER_COLOURS = dict(zip(_LEARNERS, (*COLOURS, FLAME, *FURTHER_COLOURS), strict=True))
"""Colours of the trained agents. All others are grey."""


def display_name(agent: str) -> str:
    """Return the display name of an agent; an external policy keeps its own name."""
    return NAMES.get(agent, agent)


def table_position(agent: str) -> int:
    """Return the position of an agent in the tables; external policies come first."""
    return list(NAMES).index(agent) if agent in NAMES else -1


def colour(agent: str) -> str:
    """Return the colour of an agent."""
    return LEARNER_COLOURS.get(agent, OUTLINE)
