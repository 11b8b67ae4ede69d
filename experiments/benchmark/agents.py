"""TODO experiments/benchmark/agents.py."""

from __future__ import annotations

from experiments.figures import COLOURS, FLAME, OUTLINE

NAMES = {
    "ppo": "PPO",
    "sac": "SAC",
    "bc": "BC",
    "dagger": "DAgger",
    "bc-ppo": "BC, then PPO",
    "expert": "expert",
    "replanner": "expert, planning anew",
    "expert-rim": "expert along the rim",
    "tape": "tape of the expert",
    "pd": "cascaded PD",
    "pretrained": "pretrained",
}
"""What agents are called, in the order of the tables."""
PAINT = dict(zip(NAMES, (*COLOURS, FLAME), strict=False))
"""Colours of what is learnt; the others are grey."""


def called(agent: str) -> str:
    """Return what an agent is called: the name in NAMES, or its own where it is not of the study."""
    return NAMES.get(agent, agent)


def place(agent: str) -> int:
    """Return an agent's place in the tables: the order of NAMES, others behind."""
    return list(NAMES).index(agent) if agent in NAMES else len(NAMES)


def colour(agent: str) -> str:
    """Return the colour of an agent."""
    return PAINT.get(agent, OUTLINE)
