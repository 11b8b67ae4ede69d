"""Imitation learning: behaviour cloning and DAgger."""

from agents.imitation.cloning import CloneConfig, clone, untrained_policy
from agents.imitation.dataset import ExpertData, concatenate, load_expert_data, with_mirror_images
from agents.imitation.dataset_aggregation import DaggerConfig, dagger
from agents.imitation.selection import BestPolicy

__all__ = [
    "BestPolicy",
    "CloneConfig",
    "DaggerConfig",
    "ExpertData",
    "clone",
    "concatenate",
    "dagger",
    "load_expert_data",
    "untrained_policy",
    "with_mirror_images",
]
