"""The conditions an agent is evaluated under: nominal, and with disturbances."""

from __future__ import annotations

import time
from collections import Counter

from agents.evaluation.protocol import protocol_episodes
from agents.evaluation.rollouts import fly
from agents.evaluation.scores import score_episodes
from agents.policies.policy import Policy
from experiments.files import Row, cache_folder
from experiments.recipes.run_spec import RunSpec
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.reference import EVALUATION_SEED

NOMINAL, COMBINED = "nominal", "combined"
"""The condition without disturbances, and the one with several at once."""
CONDITIONS = {
    NOMINAL: Disturbances(),
    "wind": Disturbances(wind=0.5),
    "mass": Disturbances(mass=0.05),
    "delay": Disturbances(action_delay=1),
    COMBINED: Disturbances(wind=0.25, mass=0.025, action_delay=1),
}
"""The disturbances of each condition. COMBINED has wind and mass at half strength, and the delay."""


def fly_conditions(policy: Policy, spec: RunSpec, agent: str) -> Row:
    """Fly a policy under all conditions, with the same seeds for every agent.

    Returns:
        "episodes": by condition, the outcomes, the steps of each episode (None where it failed) and the wall time [s].
        "k_star": K* of each episode, for the condition with most episodes.
        "actions": on a scenario, the actions of the nominal episode, shape (K, 2).
    """
    row: Row = {"episodes": {}, "k_star": []}
    for condition, disturbances in CONDITIONS.items():
        began = time.perf_counter()
        count = episode_count(spec, agent, condition)
        flights = fly(policy, spec.target, count, EVALUATION_SEED, disturbances)
        scores = score_episodes(flights, spec.target, EVALUATION_SEED, disturbances=disturbances, store=cache_folder())
        row["episodes"][condition] = {
            "outcomes": dict(Counter(flights.outcomes)),
            "steps": [
                int(steps) if word == "goal" else None
                for steps, word in zip(flights.steps, flights.outcomes, strict=True)
            ],
            "wall_time_s": round(time.perf_counter() - began, 2),
        }
        row["k_star"] = max(row["k_star"], scores["k_star"].tolist(), key=len)
        if condition == NOMINAL and not spec.is_distribution:
            # The shortest decimal that reads as the same float32.
            row["actions"] = [[float(str(value)) for value in action] for action in flights.actions[0]]
    return row


def episode_count(spec: RunSpec, agent: str, condition: str) -> int:
    """Return the number of episodes, on a distribution at most that of `protocol_episodes`, whose K* are shipped.

    One suffices for the nominal condition on a scenario, which is deterministic.
    """
    budget = spec.budget
    if condition == NOMINAL and not spec.is_distribution:
        return 1
    if agent == "mpc":
        return budget.mpc_episodes
    few = condition != NOMINAL or agent in ("expert", "open-loop")  # which need a plan for each episode
    wanted = budget.disturbed_episodes if few else budget.nominal_episodes
    return min(wanted, protocol_episodes(spec.target)) if spec.is_distribution else wanted
