"""Reinforcement learning with Stable-Baselines3: configurations, models, curricula, checkpoints."""
