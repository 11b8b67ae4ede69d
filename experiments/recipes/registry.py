"""The recipes of the learners' study: how each agent comes about, on one scenario and on a distribution.

    RECIPES["dagger"](Lesson("hoop", seed=0, folder=Path("runs")))    # -> Made: the policy, and what it cost
    EXPERTS["tape"](Lesson("random-goal", seed=0, folder=Path("runs")))

On the scenario the expert is the regulator about one optimal flight, planned through hoops narrower than they are, so
that who errs a little still flies through (`experiments.recipes.pretraining`). On the distribution every flight has its own
plan. All recipes that imitate see the same flights, planned once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from agents.evaluation.checks import VALIDATION_SEED
from experiments.recipes.baselines import cascade, expert, grazing, pretrained, replanner, tape
from experiments.recipes.imitation import advised, clone
from experiments.recipes.lesson import RunSpec, TrainedAgent, best_known
from experiments.recipes.plans import plans
from experiments.recipes.reinforcement import ppo, sac, tuned
from flatgym.scenarios.reference import EVALUATION_SEED


def prepare(lesson: RunSpec, agents: Collection[str]) -> float:
    """Plan what some agents need to begin; return K* of a problem's checks: on a distribution the mean of its flights'.

    Args:
        lesson: whose problem and sizes count.
        agents: who is going to be made.
    """
    sizes = lesson.sizes
    if not lesson.drawn:
        return best_known(lesson)
    if not IMITATORS.isdisjoint(agents):
        plans(lesson, 0, sizes.planned)
    if not PILOTS.isdisjoint(agents):
        plans(lesson, EVALUATION_SEED, sizes.disturbed)
    checked, _ = plans(lesson, VALIDATION_SEED, sizes.n_eval_episodes, share=1.0)
    return float(np.mean([flight.steps for flight in checked]))


Recipe = Callable[[RunSpec], TrainedAgent]
LEARNERS: dict[str, Recipe] = {"ppo": ppo, "sac": sac, "bc": clone, "dagger": advised, "bc-ppo": tuned}
"""What is learnt, once for each seed."""
EXPERTS: dict[str, Recipe] = {
    "expert": expert,
    "tape": tape,
    "pd": cascade,
    "pretrained": pretrained,
    "expert-rim": grazing,
    "replanner": replanner,
}
"""What knows how to fly already, and knows no seed."""
ONLY_SCENARIOS = ("expert-rim", "replanner")
"""Those that are flown on scenarios only."""
IMITATORS, PILOTS = {"bc", "dagger", "bc-ppo"}, {"expert", "tape"}
"""Those that on a distribution learn from planned flights, and those that fly plans of their own."""
