"""Expert data: observations and the expert's actions, from recorded demonstrations or from an oracle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import minari
import numpy as np
from numpy.typing import NDArray

from agents.demonstrations.verification import check
from flatgym.task.observation import OBSERVATION_NAMES


class ExpertData(NamedTuple):
    """Labelled observations.

    Attributes:
        observations: float32, shape (n, 19).
        actions: the expert's actions, float32, shape (n, 2).
        env_steps: environment steps of the policy that visited the states; 0 for states of the expert.
        labels: expert labels; fewer than n where rows are repeated or mirrored.
    """

    observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    env_steps: int = 0
    labels: int = 0


def load_expert_data(dataset: minari.MinariDataset, problem: str) -> ExpertData:
    """Return the expert data of a dataset of demonstrations.

    Args:
        dataset: as `agents.demonstrations.record` makes it.
        problem: name of the scenario or distribution that is to be learnt.

    Raises:
        ValueError: for a dataset of another environment or scenario, naming both.
    """
    check(dataset, problem)
    episodes = list(dataset.iterate_episodes())
    return ExpertData(
        np.concatenate([episode.observations[:-1] for episode in episodes]),
        np.concatenate([episode.actions for episode in episodes]),
        labels=int(dataset.total_steps),
    )


def concatenate(parts: Sequence[ExpertData]) -> ExpertData:
    """Return the rows of all parts in one, counts added; no rows for no parts."""
    nothing = ExpertData(np.zeros((0, len(OBSERVATION_NAMES)), np.float32), np.zeros((0, 2), np.float32))
    observations, actions, env_steps, labels = zip(nothing, *parts, strict=True)
    return ExpertData(np.concatenate(observations), np.concatenate(actions), sum(env_steps), sum(labels))


def with_mirror_images(data: ExpertData) -> ExpertData:
    """Return the data followed by its mirror image at x = 0, under which the dynamics are symmetric."""
    signs = [-1 if name.endswith(("_x", "sin_theta")) else 1 for name in OBSERVATION_NAMES]
    turned = np.array([1, -1], dtype=np.float32)
    reflected = ExpertData(data.observations * np.array(signs, dtype=np.float32), data.actions * turned)
    return concatenate([data, reflected])
