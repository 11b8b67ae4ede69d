"""DAgger: the policy visits states, an expert labels them, and the policy is fitted to all labels so far.

    dagger(untrained_policy(config), oracle, config, BestPolicy(config))    # oracles: `agents.imitation.oracles`

Behaviour cloning (`agents.imitation.cloning`) covers only the states of the expert. Small errors lead to states
without labels. DAgger (Ross, Gordon and Bagnell 2011) therefore rolls out the policy, asks an expert oracle for the
actions at the visited states, adds these labels to the data, and fits again. The best policy of all rounds is returned.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from stable_baselines3 import PPO

from agents.imitation.cloning import CloneConfig, fit
from agents.imitation.dataset import ExpertData, concatenate
from agents.imitation.selection import BestPolicy
from agents.training.fields import Count, Positive


@dataclass(frozen=True)
class DaggerConfig(CloneConfig):
    """Configuration of DAgger, without the oracle."""

    gradient_steps: Count = 1000
    """Gradient steps of each round."""
    rounds: Count = 8
    """Rounds of rolling out, labelling and fitting."""
    max_seconds: Positive = 600.0
    """Wall time after which no further round begins [s]."""


ExpertOracle = Callable[[PPO | None, int], ExpertData]
"""Takes a policy (None: the expert itself) and a round; rolls it out and returns the expert's labels."""


def dagger(model: PPO, oracle: ExpertOracle, config: DaggerConfig, best: BestPolicy) -> PPO:
    """Run DAgger and return the model with the best weights.

    Args:
        model: an `untrained_policy`, or a policy to improve.
        oracle: rolls out the policy and returns the expert's labels; round 0 rolls out the expert.
        config: rounds, time limit and gradient steps.
        best: validates after each round. DAgger ends when its target is reached or the time is up.
    """
    data = [oracle(None, 0)]
    for number in range(1, config.rounds + 1):
        fit(model, concatenate(data), config, share=1 - (number - 1) / config.rounds)
        best.validate(model)
        if best.target_reached or best.elapsed > config.max_seconds or number == config.rounds:
            break
        data.append(oracle(model, number))
        best.env_steps += data[-1].env_steps
    return best.load_best(model)
