"""Reinforcement learning recipes: PPO and SAC with default configurations, and PPO fine-tuning of a cloned policy."""

from __future__ import annotations

import json
from dataclasses import replace

from agents import policies
from agents.training.configs import Config, PPOConfig, SACConfig
from agents.training.train import Training, train
from experiments.recipes.run_spec import RunSpec, TrainedAgent


def train_ppo(spec: RunSpec) -> TrainedAgent:
    """Train PPO with its default configuration."""
    return with_default_config(spec, PPOConfig, spec.budget.ppo_steps)


def train_sac(spec: RunSpec) -> TrainedAgent:
    """Train SAC with its default configuration."""
    return with_default_config(spec, SACConfig, spec.budget.sac_steps)


def with_default_config(spec: RunSpec, kind: type[Config], env_steps: int) -> TrainedAgent:
    """Train with the default configuration of an algorithm, over that many environment steps."""
    config = kind(
        scenario=spec.problem,
        seed=spec.seed,
        max_seconds=spec.budget.max_seconds,
        env_steps=env_steps,
        folder=str(spec.file(kind.algorithm.lower(), "")),
        n_eval_episodes=spec.budget.n_eval_episodes,
    )
    return train_or_resume(spec, config)


def train_bc_ppo(spec: RunSpec) -> TrainedAgent:
    """Train PPO without a curriculum, from the policy cloned with the same seed; the cost of both is added."""
    budget = spec.budget
    config = PPOConfig(
        scenario=spec.problem,
        seed=spec.seed,
        policy=str(spec.file("bc", ".zip")),
        max_seconds=budget.finetuning_s,
        env_steps=budget.finetuning_steps,
        folder=str(spec.file("bc-ppo", "")),
        n_eval_episodes=budget.n_eval_episodes,
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
