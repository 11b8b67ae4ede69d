"""The protocol of a score: how many episodes, of which seeds; docs/evaluation.md states it in full.

protocol_episodes("random-goal")        # 1000
seed_warning(model, "random-goal", 5, 100)
"""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.evaluation.rollouts import NO_DISTURBANCES
from agents.policies.adapters import innermost
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import ProblemLike
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.reference import EVALUATION_SEED, drawn_k_star
from flatgym.scenarios.scenario import Scenario

DISTURBED_EPISODES = 200
"""Episodes under disturbances."""
OWN_EPISODES = 100
"""Episodes on a distribution without shipped K*."""
EPISODES_MOST = 10_000


def protocol_episodes(problem: ProblemLike, disturbances: Disturbances = NO_DISTURBANCES) -> int:
    """Return the number of episodes of a score: as many as have a shipped K*, and one where all are equal."""
    target = catalogue.problem(problem)
    if disturbances.active:
        return DISTURBED_EPISODES
    if isinstance(target, Scenario):
        return 1
    shipped = np.isfinite(drawn_k_star(target, EVALUATION_SEED + np.arange(EPISODES_MOST)).k_star)
    return int(shipped.sum()) or OWN_EPISODES


def seed_warning(
    policy: Any, problem: ProblemLike, seed: int, episodes: int, disturbances: Disturbances = NO_DISTURBANCES
) -> str:
    """Return in a sentence that a training may have met the scored episodes, "" if not.

    Vehicle i of a training with seed s begins with the episode of seed s + i in vector environments of Gymnasium and
    Stable-Baselines3; `agents.make_vec_env` keeps away from scored seeds. A zip holds s and the number of vehicles, and
    not which environments they were.

    Args:
        policy: the policy; a model of Stable-Baselines3 knows its seed.
        problem, seed, episodes, disturbances: of the score.
    """
    if isinstance(catalogue.problem(problem), Scenario) and not disturbances.active:
        return ""  # all episodes are equal
    model = innermost(policy)
    own, vehicles = getattr(model, "seed", None), getattr(model, "n_envs", 1)
    if isinstance(own, int) and isinstance(vehicles, int) and own < seed + episodes and seed < own + vehicles:
        return (
            f"the policy was trained with seed {own} on {vehicles} vehicles, so its training may have met "
            f"episodes of this score; choose --seed {max(own + vehicles, EVALUATION_SEED)}"
        )
    if seed < EVALUATION_SEED:
        return (
            f"seeds below {EVALUATION_SEED:,} are for training, so the policy may know these episodes; scores begin at "
            f"seed {EVALUATION_SEED}"
        )
    return ""
