"""TODO agents/imitation/dataset.py."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import minari
import numpy as np
from numpy.typing import NDArray

from agents.demonstrations.recording import check
from flatgym.task.observation import OBSERVATION_NAMES


class Shown(NamedTuple):
    """What was shown.

    Attributes:
        observations: float32, shape (n, 19).
        actions: what to do there, float32, shape (n, 2).
        flown: environment steps that a learner flew for it.
        asked: steps for which an expert said what to do; there may be more rows, as of mirror images.
    """

    observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    flown: int = 0
    asked: int = 0


def recorded(dataset: minari.MinariDataset, problem: str) -> Shown:
    """Return what a dataset of demonstrations of a scenario or distribution shows.

    Raises:
        ValueError: for a dataset of another environment or scenario, naming both.
    """
    check(dataset, problem)
    episodes = list(dataset.iterate_episodes())
    return Shown(
        np.concatenate([episode.observations[:-1] for episode in episodes]),
        np.concatenate([episode.actions for episode in episodes]),
        asked=int(dataset.total_steps),
    )


def joined(parts: Sequence[Shown]) -> Shown:
    """Return all that was shown as one."""
    nothing = Shown(np.zeros((0, len(OBSERVATION_NAMES)), np.float32), np.zeros((0, 2), np.float32))
    observations, actions, flown, asked = zip(nothing, *parts, strict=True)
    return Shown(np.concatenate(observations), np.concatenate(actions), sum(flown), sum(asked))


def mirrored(shown: Shown) -> Shown:
    """Return what was shown and its mirror image at x = 0, of which physics knows no difference."""
    signs = [-1 if name.endswith(("_x", "sin_theta")) else 1 for name in OBSERVATION_NAMES]
    turned = np.array([1, -1], dtype=np.float32)
    reflected = Shown(shown.observations * np.array(signs, dtype=np.float32), shown.actions * turned)
    return joined([shown, reflected])
