"""K* of the scenarios of a score: what is shipped at once, the rest from a folder or from the solver.

    optima("random-goal", seeds).k_star

The named scenarios and the draws that scores are flown on are known (`flatgym.reference`); whatever else is asked
for is computed by `optimal.fewest_steps`, on all cores, with a progress bar where it takes long.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import ProblemLike
from flatgym.scenarios.reference import drawn_k_star, reference
from flatgym.scenarios.scenario import Scenario
from optimal.batch import fewest_steps_many
from optimal.discrete.fewest_steps import TIME_BUDGET, FewestSteps
from optimal.flights.solution import SolveFailed


class Optima(NamedTuple):
    """K* of n flights.

    Attributes:
        k_star: the fewest environment steps known, NaN where no flight was found, shape (n,).
        proven: whether no flight whatever takes fewer, shape (n,).
    """

    k_star: Array
    proven: NDArray[np.bool_]

    @classmethod
    def of(cls, answers: Sequence[FewestSteps]) -> Optima:
        """Return what n answers say."""
        steps = np.array([answer.steps for answer in answers], dtype=np.float64)
        found = np.isfinite(steps)
        proven = np.array([answer.proven for answer in answers])
        return cls(np.where(found, steps, np.nan), found & proven)

    def repeat(self, n: int) -> Optima:
        """Return these n times over."""
        return Optima(np.repeat(self.k_star, n), np.repeat(self.proven, n))


def optima(problem: ProblemLike, seeds: NDArray[np.int64], store: str | Path | None = None) -> Optima:
    """Return K* of a scenario for every seed, or of the scenarios that a distribution draws from them.

    Args:
        problem: a scenario or a distribution.
        seeds: shape (n,).
        store: a folder in which K* that had to be computed are kept, and looked up.

    Raises:
        SolveFailed: when no flight is found for any of them.
    """
    target = catalogue.problem(problem)
    if isinstance(target, Scenario):
        return _of_scenario(target, store).repeat(len(seeds))
    drawn = drawn_k_star(target, seeds)
    known = Optima(drawn.k_star, drawn.proven)
    missing = np.flatnonzero(np.isnan(known.k_star))
    if missing.size:
        answers = fewest_steps_many([target.scenario(int(seed)) for seed in seeds[missing]], store=store)
        known.k_star[missing], known.proven[missing] = Optima.of(answers)
        if np.isnan(known.k_star).all():
            raise SolveFailed(answers[0].scenario, answers[0])
    return known


def _of_scenario(target: Scenario, store: str | Path | None) -> Optima:
    """Return K* of one scenario, once."""
    if (known := reference(target)) is not None:
        return Optima(np.array([float(known.k_star)]), np.array([known.proven]))
    (answer,) = fewest_steps_many([target], jobs=1, store=store, time_budget=TIME_BUDGET)
    if not np.isfinite(answer.steps):
        raise SolveFailed(target, answer)
    return Optima.of([answer])
