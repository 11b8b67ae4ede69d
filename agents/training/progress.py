"""Progress of a training: the state that is carried from rollout to rollout, and the files of its folder."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import torch

from agents.evaluation.validation import Point, best_of
from agents.training.configs import Config


@dataclass
class Progress:
    """State of a training besides the model; a checkpoint stores it.

    Attributes:
        segment: completed segments, each of which ends with a checkpoint.
        rollouts: completed rollouts.
        learning_rate: current learning rate.
        approx_kl: approximate Kullback-Leibler divergence of the last update; 0 if unknown.
        seconds: wall time of the previous sessions [s].
        curve: the learning curve, one point a validation.
        flight: actions (K, 2) and excess of the best flight, see `agents.training.self_imitation`; None without one.
    """

    segment: int = 0
    rollouts: int = 0
    learning_rate: float = 0.0
    approx_kl: float = 0.0
    seconds: float = 0.0
    curve: list[Point] = field(default_factory=list)
    flight: tuple[torch.Tensor, float] | None = None

    @property
    def best(self) -> Point | None:
        """The best point of the curve, None if no episode succeeded yet."""
        return best_of(self.curve)


def curve_file(config: Config) -> Path:
    """Return the file of the learning curve, one JSON object a line."""
    return Path(config.folder) / "curve.jsonl"


def model_file(config: Config) -> Path:
    """Return the file of the best policy."""
    return Path(config.folder) / "model.zip"


def read_curve(config: Config) -> list[Point]:
    """Return the learning curve so far; the training may still be running."""
    try:
        lines = curve_file(config).read_text(encoding="utf-8").splitlines(keepends=True)
    except FileNotFoundError:
        return []
    return [json.loads(line) for line in lines if line.endswith("\n")]
