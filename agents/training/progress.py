"""TODO agents/training/progress.py."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

from agents.evaluation.checks import Point, rank
from agents.training.configs import Config


@dataclass
class Progress:
    """How far a training is.

    Attributes:
        chapter: checkpoints passed.
        rollouts: rollouts flown.
        rate: present learning rate.
        divergence: Kullback-Leibler divergence of the last update; 0 where it is not known.
        seconds: wall time of training until this session [s].
        curve: one point a check.
    """

    chapter: int = 0
    rollouts: int = 0
    rate: float = 0.0
    divergence: float = 0.0
    seconds: float = 0.0
    curve: list[Point] = field(default_factory=list)

    @property
    def best(self) -> Point | None:
        """The first of the best points of the curve, None where no flight succeeded yet."""
        best = max(self.curve, key=rank, default=None)
        return best if best and best["success_rate"] > 0 else None


def curve_file(config: Config) -> Path:
    """Return the file to which a training appends its learning curve, one JSON object a line."""
    return Path(config.folder) / "curve.jsonl"


def model_file(config: Config) -> Path:
    """Return the file in which a training keeps its best policy."""
    return Path(config.folder) / "model.zip"


def read_curve(config: Config) -> list[Point]:
    """Return the learning curve so far, also of a training that is still running."""
    try:
        lines = curve_file(config).read_text(encoding="utf-8").splitlines(keepends=True)
    except FileNotFoundError:
        return []
    return [json.loads(line) for line in lines if line.endswith("\n")]
