"""All recipes by agent name, and what must be planned before they run.

    LEARNERS["dagger"](RunSpec("hoop", seed=0, folder=Path("runs")))    # -> TrainedAgent
    EXPERTS["open-loop"](RunSpec("random-goal", seed=0, folder=Path("runs")))

On a scenario the expert is an LQR around one optimal flight, planned with margins (`experiments.recipes.margins`).
On a distribution every episode has a plan of its own. All imitation recipes use the same flights, planned once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial

import numpy as np

from agents.evaluation.validation import VALIDATION_SEED
from agents.training.configs import CrossQConfig, DQNConfig, QRDQNConfig, SACConfig, TD3Config, TQCConfig
from experiments.recipes.baselines import (
    cascaded_pd,
    expert,
    expert_no_margin,
    hover,
    mpc,
    open_loop,
    pretrained,
    random_actions,
)
from experiments.recipes.imitation import BINS, train_bc, train_dagger
from experiments.recipes.plans import plan_flights
from experiments.recipes.reinforcement import train_bc_ppo, train_gaussian_ppo, train_off_policy, train_ppo
from experiments.recipes.run_spec import RunSpec, TrainedAgent
from flatgym.scenarios.reference import EVALUATION_SEED

Recipe = Callable[[RunSpec], TrainedAgent]
LEARNERS: dict[str, Recipe] = {
    "ppo": train_ppo,
    "ppo-gaussian": train_gaussian_ppo,
    "sac": partial(train_off_policy, kind=SACConfig),
    "td3": partial(train_off_policy, kind=TD3Config),
    "tqc": partial(train_off_policy, kind=TQCConfig),
    "crossq": partial(train_off_policy, kind=CrossQConfig),
    "dqn": partial(train_off_policy, kind=DQNConfig),
    "qrdqn": partial(train_off_policy, kind=QRDQNConfig),
    "bc": train_bc,
    "dagger": train_dagger,
    "bc-ppo": train_bc_ppo,
    "bc-categorical": partial(train_bc, bins=BINS),
    "dagger-categorical": partial(train_dagger, bins=BINS),
}
"""Trained agents; each seed is a training run."""
EXPERTS: dict[str, Recipe] = {
    "expert": expert,
    "open-loop": open_loop,
    "pd": cascaded_pd,
    "hover": hover,
    "random": random_actions,
    "pretrained": pretrained,
    "expert-no-margin": expert_no_margin,
    "mpc": mpc,
}
"""Agents without training, and without a seed."""
COMPARED_ON_FEW = (
    "ppo-gaussian", "sac", "td3", "tqc", "crossq", "dqn", "qrdqn", "bc-ppo", "bc-categorical", "dagger-categorical",
)  # fmt: skip
"""Learners that the full suite trains on two problems only, to end within a day."""
SCENARIO_ONLY = ("expert-no-margin", "mpc")
"""Agents that fly scenarios, but no distributions."""
NEED_DEMONSTRATIONS = {"bc", "dagger", "bc-ppo", "bc-categorical", "dagger-categorical"}
NEED_PLANS = {"expert", "open-loop"}
"""Agents that on a distribution need optimal flights for training, and those that need one for each episode."""


def prepare(spec: RunSpec, agents: Collection[str]) -> float:
    """Plan the flights that some agents need, and return K* of validation, on a distribution the episodes' mean.

    Args:
        spec: the task and the budget; the seed is not used.
        agents: names of the agents to run.
    """
    budget = spec.budget
    if not spec.is_distribution:
        return spec.k_star
    if not NEED_DEMONSTRATIONS.isdisjoint(agents):
        plan_flights(spec, 0, budget.demonstrations)
    if not NEED_PLANS.isdisjoint(agents):
        plan_flights(spec, EVALUATION_SEED, budget.disturbed_episodes)
    validation, _ = plan_flights(spec, VALIDATION_SEED, budget.n_eval_episodes, share=1.0)
    return float(np.mean([flight.steps for flight in validation]))
