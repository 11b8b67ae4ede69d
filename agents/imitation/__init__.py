"""Imitation learning: behaviour cloning and DAgger."""

from agents.imitation.cloning import CloneConfig, clone, student
from agents.imitation.dataset import Shown, joined, mirrored, recorded
from agents.imitation.dataset_aggregation import DaggerConfig, dagger
from agents.imitation.selection import BestPolicy

__all__ = [
    "BestPolicy",
    "CloneConfig",
    "DaggerConfig",
    "Shown",
    "clone",
    "dagger",
    "joined",
    "mirrored",
    "recorded",
    "student",
]
