"""K* of the scenarios of a score: shipped values first, then those cached in a folder, then the solver.

    optima("random-goal", seeds).k_star
    best_known("my_track.toml", store=cache)    # as `flatgym.reference`, for any scenario

K* of the named scenarios and of the evaluation seeds is shipped (`flatgym.scenarios.reference`). Other values are
computed by `optimal.fewest_steps` on all cores, with a progress bar if it takes long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import ProblemLike, ScenarioLike
from flatgym.scenarios.reference import Reference, drawn_k_star, reference
from flatgym.scenarios.scenario import Scenario
from optimal.batch import fewest_steps_many
from optimal.discrete.fewest_steps import TIME_BUDGET, FewestSteps
from optimal.flights.solution import SolveFailed
from optimal.store import stored_answers


class Optima(NamedTuple):
    """K* of n scenarios.

    Attributes:
        k_star: fewest environment steps known, NaN if no flight was found, shape (n,).
        proven: whether fewer steps are proven impossible, shape (n,).
    """

    k_star: Array
    proven: NDArray[np.bool_]

    @classmethod
    def of(cls, answers: Sequence[FewestSteps]) -> Optima:
        """Return K* of n solver results."""
        steps = np.array([answer.steps for answer in answers], dtype=np.float64)
        found = np.isfinite(steps)
        proven = np.array([answer.proven for answer in answers])
        return cls(np.where(found, steps, np.nan), found & proven)

    def repeat(self, n: int) -> Optima:
        """Return every entry n times."""
        return Optima(np.repeat(self.k_star, n), np.repeat(self.proven, n))


def optima(problem: ProblemLike, seeds: NDArray[np.int64], store: str | Path | None = None) -> Optima:
    """Return K* for every seed: that of the scenario, or of the scenario that a distribution samples from the seed.

    Args:
        problem: a scenario or a distribution.
        seeds: shape (n,).
        store: folder that caches computed K*.

    Raises:
        SolveFailed: if no flight is found for any of them.
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
    """Return K* of one scenario, with n = 1."""
    if (known := reference(target)) is not None:
        return Optima(np.array([float(known.k_star)]), np.array([known.proven]))
    answer = flight_in_k_star(target, store)
    if not np.isfinite(answer.steps):
        raise SolveFailed(target, answer)
    return Optima.of([answer])


def flight_in_k_star(target: Scenario, store: str | Path | None = None) -> FewestSteps:
    """Return the best flight of a scenario in a folder, whatever it is called there; computed if there is none."""
    if store is not None and (best := stored_flight(target, store)) is not None:
        return best
    (answer,) = fewest_steps_many([target], jobs=1, store=store, progress=False, time_budget=TIME_BUDGET)
    return answer


def stored_flight(target: Scenario, store: str | Path) -> FewestSteps | None:
    """Return the flight in the fewest steps in a folder, of equal ones that with the best bound; None without one."""
    flights = [answer for answer in stored_answers(store, target) if isinstance(answer, FewestSteps)]
    found = [flight for flight in flights if np.isfinite(flight.steps)]
    return min(found, key=lambda flight: (flight.steps, -flight.lower_bound), default=None)


def best_known(problem: ScenarioLike, store: str | Path | None = None) -> Reference | None:
    """Return the best-known solution of any scenario: the shipped one, or else that of `flight_in_k_star`.

    Its T* and the bound of T* are NaN unless it is shipped.

    Args:
        problem: a scenario.
        store: folder that caches computed K*.

    Returns:
        The solution; None if no flight is found.
    """
    target = catalogue.scenario(problem)
    if (known := reference(target)) is not None:
        return known
    answer = flight_in_k_star(target, store)
    if not np.isfinite(answer.steps):
        return None
    return Reference(
        scenario=catalogue.label(target),
        k_star=int(answer.steps),
        k_lower_bound=answer.lower_bound,
        proven=answer.proven,
        time=math.nan,
        time_lower_bound=math.nan,
        winding=answer.winding,
        actions=answer.actions,
    )
