"""Imitation: a network learns what an expert does, from recorded flights and from its own.

    clone(recorded(minari.load_dataset("flatquad/hoop/optimal-v0"), "hoop"), CloneConfig(scenario="hoop"))
    dagger(student(config), adviser, config, Keeper(config))    # advisers: `agents.imitation.advisers`

Behaviour cloning fits the actions of recorded flights (Pomerleau 1989). What it learns about is where the expert
went; a small error leads elsewhere, where nobody showed what to do. DAgger (Ross, Gordon and Bagnell 2011) therefore
flies the learner, asks the expert what it would have done from where the learner came to, adds that to what there is,
and fits again. The policy that flies best of all rounds is kept.

A time-optimal flight has its controls mostly at a limit, and the network's output is clipped. So where the expert's
action is at a limit, whatever lies beyond counts as equal to it: nothing is spent on how far beyond.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from stable_baselines3 import PPO

from agents.imitation.cloning import CloneConfig, fit
from agents.imitation.dataset import Shown, joined
from agents.imitation.selection import BestPolicy
from agents.training.fields import Count, Positive


@dataclass(frozen=True)
class DaggerConfig(CloneConfig):
    """Everything DAgger depends on, besides the adviser."""

    gradient_steps: Count = 1000
    """Gradient steps of each round."""
    rounds: Count = 8
    """Rounds of flying, asking and fitting."""
    max_seconds: Positive = 600.0
    """Wall time after which no further round begins [s]."""


ExpertOracle = Callable[[PPO | None, int], Shown]
"""Flies a learner, or the expert itself where there is none yet, in a round, and returns what the expert would do."""


def dagger(model: PPO, adviser: ExpertOracle, config: DaggerConfig, keeper: BestPolicy) -> PPO:
    """Let a model fly, be advised, and learn, round by round; return it as it flew best (DAgger).

    Args:
        model: a `student`, or one that has learnt something.
        adviser: flies it, and says what the expert would have done.
        config: rounds, time and gradient steps.
        keeper: checks it after each round; the last ends when time is up, or nothing can be improved.
    """
    shown = [adviser(None, 0)]
    for number in range(1, config.rounds + 1):
        fit(model, joined(shown), config, share=1 - (number - 1) / config.rounds)
        keeper.check(model)
        if keeper.satisfied or keeper.elapsed > config.max_seconds or number == config.rounds:
            break
        shown.append(adviser(model, number))
        keeper.env_steps += shown[-1].flown
    return keeper.restore(model)
