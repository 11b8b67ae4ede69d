"""TODO experiments/recipes/reinforcement.py."""

from __future__ import annotations

import json
from dataclasses import replace

from agents.training.configs import Config, PPOConfig, SACConfig
from agents.training.train import Training, load, train
from experiments.recipes.lesson import RunSpec, TrainedAgent, best_known


def ppo(lesson: RunSpec) -> TrainedAgent:
    """PPO by its default recipe."""
    return reinforced(lesson, PPOConfig, lesson.sizes.ppo_steps)


def sac(lesson: RunSpec) -> TrainedAgent:
    """SAC by its default recipe."""
    return reinforced(lesson, SACConfig, lesson.sizes.sac_steps)


def reinforced(lesson: RunSpec, kind: type[Config], env_steps: int) -> TrainedAgent:
    """Train by an algorithm's default recipe, over so many environment steps."""
    config = kind(
        scenario=lesson.problem,
        seed=lesson.seed,
        max_seconds=lesson.sizes.max_seconds,
        env_steps=env_steps,
        folder=str(lesson.file(kind.algorithm.lower(), "")),
        n_eval_episodes=lesson.sizes.n_eval_episodes,
    )
    return trained(lesson, config)


def tuned(lesson: RunSpec) -> TrainedAgent:
    """PPO on the problem as it is, from the policy cloned with the same seed; what that one cost is added."""
    sizes, first = lesson.sizes, lesson.file("bc", ".zip")
    config = PPOConfig(
        scenario=lesson.problem,
        seed=lesson.seed,
        policy=str(first),
        max_seconds=sizes.tuning_s,
        env_steps=sizes.tuning_steps,
        folder=str(lesson.file("bc-ppo", "")),
        n_eval_episodes=sizes.n_eval_episodes,
        tolerance=1.0,
        pool_share=0.0,
        pool_share_end=0.0,
        log_std_init=-2.5,
        learning_rate=1e-4,
        target_kl=0.005,
    )
    made, before = trained(lesson, config), json.loads(lesson.file("bc", ".json").read_text(encoding="utf-8"))
    shown, spent = before["expert_steps"], before["wall_time_s"]
    later = [p | {"expert_steps": shown, "wall_time_s": p["wall_time_s"] + spent} for p in made.curve]
    return replace(
        made,
        algorithm="BC, PPO",
        curve=[*before["curve"], *later],
        expert_steps=shown,
        wall_time_s=made.wall_time_s + spent,
        planning_s=before["planning_s"],
    )


def trained(lesson: RunSpec, config: Config) -> TrainedAgent:
    """Train by reinforcement, on from a killed run's checkpoint where there is one."""
    done: Training = train(config, best_known(lesson) or None, resume=True)
    curve = [point | {"expert_steps": 0} for point in done.curve]
    return TrainedAgent(load(done.model), config.algorithm, [config], curve, done.env_steps, 0, done.wall_time_s)
