"""Replay of recorded flights: their actions, exactly as recorded, in the NumPy environment or in the compiled one.

    replay("hoop", 0, [actions]).outcomes

A flight is a function of scenario, seed, disturbances and actions. Sensor noise changes observations only, so disturbed
flights replay too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.evaluation.rollouts import NO_DISTURBANCES
from flatgym.envs.compiled_fleet import CompiledFleet
from flatgym.envs.config import EnvConfig
from flatgym.envs.fleet import END, Fleet
from flatgym.envs.numpy_fleet import NumpyFleet
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import ProblemLike
from flatgym.scenarios.disturbances import Disturbances
from flatgym.task.scene import FLYING, OUTCOMES

FLEETS: dict[str, type[Fleet]] = {"NumPy": NumpyFleet, "compiled": CompiledFleet}
"""The implementations of the environment, by name."""


@dataclass(frozen=True)
class Replay:
    """Results of n replayed flights.

    Attributes:
        outcomes: outcome of each flight, n words of OUTCOMES; "flying" if it has not ended after its last action.
        steps: steps after which each flight ended, or the number of its actions, shape (n,).
    """

    outcomes: tuple[str, ...]
    steps: NDArray[np.int64]


def replay(
    problem: ProblemLike,
    seed: int,
    actions: Sequence[NDArray[np.float32]],
    disturbances: Disturbances = NO_DISTURBANCES,
    *,
    implementation: str = "NumPy",
    margin: float = 0.0,
) -> Replay:
    """Return how flights end.

    Args:
        problem: a scenario or a distribution.
        seed: seed of the first flight; flight i has seed + i.
        actions: actions of each flight, n arrays of shape (K, 2) within [-1, 1].
        disturbances: those under which the flights were recorded.
        implementation: one of FLEETS.
        margin: as in `EnvConfig`.
    """
    n, counts = len(actions), np.array([len(one) for one in actions])
    config = EnvConfig(catalogue.problem(problem), "sparse", disturbances=disturbances, margin=margin)
    table = np.zeros((counts.max(initial=0), n, 2))
    for i, one in enumerate(actions):
        table[: len(one), i] = one
    fleet, every = FLEETS[implementation](config, n), np.ones(n, dtype=bool)
    fleet.reseed(every, np.uint64(seed) + np.arange(n, dtype=np.uint64))
    fleet.reset(every)
    steps, outcomes = counts.copy(), np.full(n, FLYING)
    for k, row in enumerate(table, 1):
        fleet.actions[...] = row
        end = fleet.step().record.numbers[END].astype(np.int64)
        ends = (outcomes == FLYING) & (end != FLYING) & (k <= counts)
        steps[ends], outcomes[ends] = k, end[ends]
    return Replay(tuple(OUTCOMES[code] for code in outcomes), steps)
