"""What a recipe receives and returns: a run specification with its budget, and the trained agent with its cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from agents.evaluation.optima import best_known
from agents.evaluation.validation import Point
from agents.policies.policy import Policy
from experiments.files import cache_folder
from flatgym.scenarios import catalogue
from flatgym.scenarios.distributions import Distribution
from flatgym.scenarios.scenario import Scenario


@dataclass(frozen=True)
class Budget:
    """Training time, sample counts and episode counts of all recipes.

    Pairs hold the value for a scenario, then the value for a distribution.

    Attributes:
        ppo_s: wall time of PPO [s]: on scenarios of at most one hoop, on tracks, on distributions without and with
            hoops.
        off_policy_s: wall time of the algorithms with a replay buffer [s].
        finetuning_s: wall time of PPO that starts from a cloned policy [s].
        ppo_steps: environment steps over which the schedules of PPO run, for the same four.
        off_policy_steps: most environment steps of an algorithm with a replay buffer.
        finetuning_steps: environment steps of PPO that starts from a cloned policy.
        expert_rollouts: episodes of the LQR expert that are cloned on a scenario; a DAgger round has half as many.
        demonstrations: optimal flights that are cloned on a distribution.
        gradient_steps: pair, gradient steps of behaviour cloning.
        rounds: pair, rounds of DAgger.
        round_gradient_steps: pair, gradient steps of one DAgger round.
        round_rollouts: episodes of a DAgger round on a distribution that the LQR labels.
        round_replans: episodes of a DAgger round on a distribution that are labelled by new optimal plans.
        dagger_s: wall time after which no DAgger round begins [s].
        n_eval_episodes: validation episodes on a distribution.
        nominal_episodes: most episodes of a policy on a distribution, without disturbances.
        disturbed_episodes: episodes under each disturbance, and of agents that need a plan for every episode.
        mpc_episodes: episodes of MPC, which takes seconds each.
    """

    ppo_s: tuple[float, float, float, float] = (300.0, 900.0, 900.0, 2400.0)
    off_policy_s: float = 900.0
    finetuning_s: float = 50.0
    ppo_steps: tuple[int, int, int, int] = (5_000_000, 30_000_000, 25_000_000, 60_000_000)
    off_policy_steps: int = 2_000_000
    finetuning_steps: int = 800_000
    expert_rollouts: int = 64
    demonstrations: int = 1_500
    gradient_steps: tuple[int, int] = (4_000, 6_000)
    rounds: tuple[int, int] = (12, 5)
    round_gradient_steps: tuple[int, int] = (1_000, 2_500)
    round_rollouts: int = 800
    round_replans: int = 40
    dagger_s: float = 250.0
    n_eval_episodes: int = 64
    nominal_episodes: int = 1_000
    disturbed_episodes: int = 200
    mpc_episodes: int = 10


FULL = Budget()
SMOKE = Budget(
    ppo_s=(4.0, 4.0, 4.0, 4.0),
    off_policy_s=4.0,
    finetuning_s=4.0,
    ppo_steps=(33_000, 33_000, 33_000, 33_000),
    off_policy_steps=2_000,
    finetuning_steps=33_000,
    expert_rollouts=4,
    demonstrations=6,
    gradient_steps=(50, 50),
    rounds=(2, 2),
    round_gradient_steps=(50, 50),
    round_rollouts=4,
    round_replans=2,
    dagger_s=4.0,
    n_eval_episodes=2,
    nominal_episodes=4,
    disturbed_episodes=3,
    mpc_episodes=1,
)
"""A smoke test's budget: everything runs, nothing is learnt."""


@dataclass(frozen=True)
class RunSpec:
    """One training run: the task, the seed, the folder and the budget.

    Attributes:
        problem: name of the scenario or distribution, or the JSON text of one's own.
        seed: of network initialisation, exploration and batches.
        folder: where flights, policies and training checkpoints are stored.
        budget: training time, sample counts and episode counts.
    """

    problem: str
    seed: int
    folder: Path
    budget: Budget = FULL

    @cached_property
    def target(self) -> Scenario | Distribution:
        """The scenario or distribution."""
        return catalogue.problem(self.problem)

    @cached_property
    def label(self) -> str:
        """The short name of the task, for file names and results."""
        return catalogue.label(self.target)

    @cached_property
    def is_distribution(self) -> bool:
        """Whether the task is a distribution; also the index into the pairs of a Budget."""
        return isinstance(self.target, Distribution)

    @cached_property
    def size(self) -> int:
        """The index into the four budgets of PPO, by kind of task and number of hoops."""
        if isinstance(self.target, Distribution):
            return 3 if max(self.target.hoops) else 2
        return 1 if len(self.target.hoops) > 1 else 0

    @cached_property
    def k_star(self) -> int:
        """K* of a scenario, where training may stop; 0 for a distribution, where it may not, and without a flight."""
        known = best_known(self.target, cache_folder()) if isinstance(self.target, Scenario) else None
        return 0 if known is None else known.k_star

    def file(self, agent: str, suffix: str) -> Path:
        """Return the path of an agent's file with that suffix; of a folder for the suffix ""."""
        return self.folder / f"{self.label}-{agent}-{self.seed}{suffix}"


@dataclass(frozen=True)
class TrainedAgent:
    """An agent and what its training cost.

    Attributes:
        policy: the policy.
        algorithm: how it was trained or built.
        configs: the training configurations, in order.
        curve: validation points with env_steps, expert_labels, wall_time_s, outcome, success_rate, steps.
        env_steps: environment steps of the policy during training.
        expert_labels: steps labelled by an expert.
        training_s: training time on one core [s].
        planning_s: time to plan the demonstrations beforehand, on all cores [s].
        fingerprint: of the policy's file, where it has one (`agents.policies.fingerprint`).
    """

    policy: Policy
    algorithm: str
    configs: Sequence[Any] = ()
    curve: Sequence[Point] = ()
    env_steps: int = 0
    expert_labels: int = 0
    training_s: float = 0.0
    planning_s: float = 0.0
    fingerprint: str | None = None
