"""Reinforcement learning recipes: PPO, the algorithms with a replay buffer, and PPO from a cloned policy."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

from agents import policies
from agents.training.configs import Config, OffPolicyConfig, PPOConfig
from agents.training.train import Training, train
from experiments.recipes.run_spec import RunSpec, TrainedAgent

DISTRIBUTION_WIDTH = 128
"""Units of the hidden layers of PPO on a distribution, twice as many as on a scenario."""
TUNED: dict[str, dict[str, Any]] = {
    "horizontal-15": {"guidance": True},
    "climb": {"turns": 1},
    "drop": {"turns": -1},
    "high-hoop": {"turns": 1, "guidance": True, "target_kl_end": 0.1},
    "slalom": {"turns": 2},
    "loop": {"turns": -1, "guidance": False},
    "split-s": {"turns": 1},
    "figure-eight": {"turns": 1},
    "slalom-6": {"turns": 3},
    "zigzag-12": {"turns": 4},
}
"""Fields of PPO that differ on single tasks. The page on agents has what else was tried. On tracks the number of turns
is that of the best flight that the solvers know; a sweep would need a training for each number."""
TURNING: dict[str, Any] = {"failure_cost": 1.5, "ent_coef": 0.01}
"""Fields of PPO where flights must turn. At the default cost, failing without a turn costs too little; and the entropy
keeps both limits of the thrust in play until the turn is learnt."""


def train_ppo(spec: RunSpec, name: str = "ppo", **values: Any) -> TrainedAgent:
    """Train PPO; arguments as of `ppo_config`."""
    return train_or_resume(spec, ppo_config(spec, name, **values))


def ppo_config(spec: RunSpec, name: str = "ppo", **values: Any) -> PPOConfig:
    """Return the configuration of PPO for a task; `values` replace its fields, and `name` is that of the agent."""
    own: dict[str, Any] = {"max_seconds": spec.budget.ppo_s[spec.size], "env_steps": spec.budget.ppo_steps[spec.size]}
    if spec.is_distribution:
        own["width"] = DISTRIBUTION_WIDTH
    own["guidance"] = spec.size > 0
    tuned = TUNED.get(spec.label, {})
    own |= (TURNING if "turns" in tuned else {}) | tuned
    return PPOConfig(**common(spec, name) | own | values)


def train_gaussian_ppo(spec: RunSpec) -> TrainedAgent:
    """Train PPO with a Gaussian actor."""
    return train_ppo(spec, "ppo-gaussian", bins=None)


def train_off_policy(spec: RunSpec, kind: type[OffPolicyConfig]) -> TrainedAgent:
    """Train an algorithm with a replay buffer, with its default configuration."""
    steps, budget = min(kind.env_steps, spec.budget.off_policy_steps), spec.budget
    config = kind(**common(spec, kind.algorithm.lower()), max_seconds=budget.off_policy_s, env_steps=steps)
    return train_or_resume(spec, config)


def common(spec: RunSpec, name: str) -> dict[str, Any]:
    """Return the fields that all trainings by reward share."""
    return {
        "scenario": spec.problem,
        "seed": spec.seed,
        "folder": str(spec.file(name, "")),
        "n_eval_episodes": spec.budget.n_eval_episodes,
    }


def train_bc_ppo(spec: RunSpec) -> TrainedAgent:
    """Train PPO without a curriculum, from the policy cloned with the same seed; the cost of both is added."""
    budget = spec.budget
    config = PPOConfig(
        **common(spec, "bc-ppo"),
        policy=str(spec.file("bc", ".zip")),
        max_seconds=budget.finetuning_s,
        env_steps=budget.finetuning_steps,
        tolerance=1.0,
        pool_share=0.0,
        pool_share_end=0.0,
        log_std_init=-2.5,
        learning_rate=1e-4,
        target_kl=0.005,
    )
    tuned, cloned = train_or_resume(spec, config), json.loads(spec.file("bc", ".json").read_text(encoding="utf-8"))
    labels, seconds = cloned["expert_labels"], cloned["training_s"]
    later = [p | {"expert_labels": labels, "wall_time_s": p["wall_time_s"] + seconds} for p in tuned.curve]
    return replace(
        tuned,
        algorithm="BC, PPO",
        curve=[*cloned["curve"], *later],
        expert_labels=labels,
        training_s=tuned.training_s + seconds,
        planning_s=cloned["planning_s"],
    )


def train_or_resume(spec: RunSpec, config: Config) -> TrainedAgent:
    """Train by reinforcement learning; an interrupted run resumes from its checkpoint."""
    done: Training = train(config, spec.k_star or None, resume=True)
    curve = [point | {"expert_labels": 0} for point in done.curve]
    return TrainedAgent(
        policies.load(done.model, trust=True), config.algorithm, [config], curve, done.env_steps, 0, done.wall_time_s
    )
