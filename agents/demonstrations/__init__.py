"""Demonstrations: optimal flights, planned, recorded as Minari datasets, replayed and exported."""

from agents.demonstrations.plans import displaced, flights_folder, plan
from agents.demonstrations.recording import Demonstration, next_seed, record, stored_dataset
from agents.demonstrations.storage import dataset_id
from agents.demonstrations.tables import export
from agents.demonstrations.verification import Replay, check, replay

__all__ = [
    "Demonstration",
    "Replay",
    "check",
    "dataset_id",
    "displaced",
    "export",
    "flights_folder",
    "next_seed",
    "plan",
    "record",
    "replay",
    "stored_dataset",
]
