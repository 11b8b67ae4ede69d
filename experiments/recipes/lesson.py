"""TODO experiments/recipes/lesson.py."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.evaluation.checks import Point
from agents.policies.policy import Policy
from flatgym.scenarios import catalogue
from flatgym.scenarios.distributions import Distribution
from flatgym.scenarios.reference import reference
from flatgym.scenarios.scenario import Scenario


@dataclass(frozen=True)
class Budget:
    """How much of everything.

    Attributes:
        seconds: wall time of PPO and of SAC [s].
        tuning_s: of PPO that starts from a cloned policy [s].
        ppo_steps, sac_steps, tuning_steps: environment steps over which their schedules run.
        shown: flights of the regulator that are cloned on a scenario.
        planned: optimal flights that are cloned on a distribution.
        updates: gradient steps of a cloning on a scenario, and on a distribution.
        rounds: of DAgger, likewise.
        round_updates: gradient steps of a round, likewise.
        followed: flights of a round of DAgger on a distribution with a regulator.
        corrected: those from which it is planned anew.
        dagger_s: wall time after which no round begins [s].
        check_episodes: flights of a check on a distribution.
        goals: undisturbed flights of a policy on a distribution.
        disturbed: flights under each disturbance, and those of experts with a plan each.
        replanned: flights of the expert that plans anew at every step, which takes seconds each.
    """

    max_seconds: float = 100.0
    tuning_s: float = 50.0
    ppo_steps: int = 2_500_000
    sac_steps: int = 50_000
    tuning_steps: int = 800_000
    shown: int = 64
    planned: int = 1_500
    gradient_steps: tuple[int, int] = (4_000, 6_000)
    rounds: tuple[int, int] = (12, 5)
    round_updates: tuple[int, int] = (1_000, 2_500)
    followed: int = 800
    corrected: int = 40
    dagger_s: float = 250.0
    n_eval_episodes: int = 64
    goals: int = 1_000
    disturbed: int = 200
    replanned: int = 10


FULL = Budget()
SMOKE = Budget(
    max_seconds=4.0,
    tuning_s=4.0,
    ppo_steps=33_000,
    sac_steps=2_000,
    tuning_steps=33_000,
    shown=4,
    planned=6,
    gradient_steps=(50, 50),
    rounds=(2, 2),
    round_updates=(50, 50),
    followed=4,
    corrected=2,
    dagger_s=4.0,
    n_eval_episodes=2,
    goals=4,
    disturbed=3,
    replanned=1,
)
"""Sizes with which everything runs, and nothing is learnt."""


@dataclass(frozen=True)
class RunSpec:
    """What is to be flown, and by whom it is to be learnt.

    Attributes:
        problem: name of the scenario or distribution.
        seed: of network, exploration and batches.
        folder: where flights, policies and the runs of trainings are kept.
        sizes: how much of everything.
    """

    problem: str
    seed: int
    folder: Path
    sizes: Budget = FULL

    @property
    def target(self) -> Scenario | Distribution:
        """The scenario or distribution itself."""
        return catalogue.problem(self.problem)

    @property
    def drawn(self) -> bool:
        """Whether it is a distribution; says which of two sizes is meant."""
        return isinstance(self.target, Distribution)

    def file(self, agent: str, ending: str) -> Path:
        """Return a file of an agent's, or for the ending "" a folder."""
        return self.folder / f"{self.problem}-{agent}-{self.seed}{ending}"


@dataclass(frozen=True)
class TrainedAgent:
    """An agent and what it cost.

    Attributes:
        policy: it.
        algorithm: by what it was made.
        configs: everything it depends on besides the lesson.
        curve: points env_steps, expert_steps, wall_time_s, outcome, success_rate, steps.
        env_steps: steps that the learner flew in the environment.
        expert_steps: steps for which an expert showed what to do.
        wall_time_s: of the learning, on one core [s].
        planning_s: of the planning of the demonstrations before, on all cores [s].
    """

    policy: Policy
    algorithm: str
    configs: Sequence[Any] = ()
    curve: Sequence[Point] = ()
    env_steps: int = 0
    expert_steps: int = 0
    wall_time_s: float = 0.0
    planning_s: float = 0.0


def best_known(lesson: RunSpec) -> int:
    """Return K* of a scenario, where training may stop; 0 of a distribution, where it may not."""
    known = reference(lesson.problem)
    return 0 if known is None else known.k_star
