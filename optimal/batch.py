"""Many scenarios at once, on all cores or on a cluster, and on from where a broken-off run stopped.

Every scenario is one task of joblib's, with seeds of its own, so that its answer depends neither on
the number of workers nor on the other scenarios. Workers are processes, each of which builds the
program of a shape once and keeps it; like scenarios stand side by side, so that they meet the same
programs. Answers come back in the order asked for; with a store, each is kept as soon as it is here.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from flatgym.scenarios.catalogue import ScenarioLike, scenario
from flatgym.scenarios.scenario import Scenario
from optimal.discrete.fewest_steps import FewestSteps, fewest_steps
from optimal.flights.certificate import Certificate
from optimal.flights.solution import Solution, Status
from optimal.minimum_time import solve
from optimal.parallel import Progress, _check_workers, _watched, unordered
from optimal.store import Store

UNPROVEN: dict[str, dict[str, Any]] = {"solve": {"max_gap": None}, "fewest_steps": {"time_budget": 0.0}}
"""Batches leave proofs out unless asked for them: they take as long as all the rest."""

Result = TypeVar("Result", Solution, FewestSteps)


def solve_many(
    scenarios: Iterable[ScenarioLike],
    *,
    jobs: int = -1,
    backend: str = "loky",
    store: str | Path | None = None,
    progress: Progress = True,
    **options: Any,
) -> list[Solution]:
    """Return what `optimal.solve` says of every scenario, in their order.

    What fails is an answer too, with status and reason, and costs the others nothing.

    Args:
        scenarios: scenarios or their names.
        jobs: worker processes; -1 is one for each core.
        backend: "loky" for processes of this machine, "ray" for a Ray cluster: the one that is running or that the
            environment variable RAY_ADDRESS names, else one of this machine.
        store: a folder in which finished answers are kept, and looked up before anything is computed; shooting only.
        progress: a bar where standard error is a terminal; or a function told how many are done and how many there are.
        options: of `optimal.solve`, but for raise_on_failure; lower bounds are proven only where max_gap is given.

    Raises:
        ValueError: for an unknown scenario, or an option that `optimal.solve` does not know.
        ImportError: for backend="ray" where Ray is not installed.
        OSError: where an answer cannot be kept, naming the file; those kept before stay.
    """
    if store is not None and options.get("method", "shooting") != "shooting":
        raise ValueError(
            f"a store keeps flights of method='shooting' only, got {options['method']!r}; leave out store="
        )
    return _many(solve, scenarios, options, jobs, backend, store, progress)


def fewest_steps_many(
    scenarios: Iterable[ScenarioLike],
    *,
    jobs: int = -1,
    backend: str = "loky",
    store: str | Path | None = None,
    progress: Progress = True,
    **options: Any,
) -> list[FewestSteps]:
    """Return what `optimal.fewest_steps` says of every scenario, in their order; see `solve_many`.

    That fewer steps are impossible is proven only where time_budget is given.
    """
    return _many(fewest_steps, scenarios, options, jobs, backend, store, progress)


def _many(
    ask: Callable[..., Result],
    scenarios: Iterable[ScenarioLike],
    options: dict[str, Any],
    jobs: int,
    backend: str,
    store: str | Path | None,
    progress: Progress,
) -> list[Result]:
    tasks = [scenario(problem) for problem in scenarios]
    options = _checked(ask, options)
    _check_workers(jobs, backend)
    kept = None if store is None else Store(store, {"ask": ask.__name__, "options": options})
    answers: dict[Scenario, Any] = {}
    for task in dict.fromkeys(tasks):
        if kept is not None and (answer := kept.read(task)) is not None:
            answers[task] = answer
    left = sorted((task for task in dict.fromkeys(tasks) if task not in answers), key=_likeness)
    found = unordered(partial(_attempt, ask, options), left, jobs, backend) if left else iter(())
    for answer in _watched(found, len(left), progress):
        answers[answer.scenario] = answer
        # What broke off may do better next time.
        if kept is not None and answer.status is not Status.BROKEN_OFF:
            kept.write(answer)
    return [answers[task] for task in tasks]


def _checked(ask: Callable[..., Any], options: dict[str, Any]) -> dict[str, Any]:
    """Return the options of a question with its defaults filled in, as plain data.

    Raises:
        ValueError: for an option that the question does not have.
    """
    parameters = inspect.signature(ask).parameters
    known = {name: parameters[name].default for name in parameters if name not in ("problem", "raise_on_failure")}
    known |= UNPROVEN[ask.__name__]
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise ValueError(f"unknown options {', '.join(unknown)}; {ask.__name__} has {', '.join(known)}")
    filled = known | options
    return {name: list(value) if isinstance(value, (tuple, range)) else value for name, value in filled.items()}


def _likeness(task: Scenario) -> tuple[int, bool, float]:
    """Return what scenarios of like programs have in common: hoops, heights, and about the way's length."""
    return len(task.hoops), task.floor is None and task.ceiling is None, math.dist(task.start, task.goal)


def _attempt(ask: Callable[..., Result], options: dict[str, Any], task: Scenario) -> Result:
    """Ask a question of one scenario; an error becomes an answer."""
    try:
        return ask(task, raise_on_failure=False, **options)
    except Exception as error:
        return broken_off(ask, task, f"{type(error).__name__}: {error}")


def broken_off(ask: Callable[..., Result], task: Scenario, reason: str) -> Any:
    """Return the answer where there is none."""
    if ask is solve:
        nothing = Certificate(), 0, math.inf, 0, 0
        return Solution(task, "none", math.inf, Status.BROKEN_OFF, 0, None, *nothing, reason)
    actions, states = np.zeros((0, 2), np.float32), np.zeros((0, 5))
    return FewestSteps(task, math.inf, actions, states, 0, math.inf, 0, Status.BROKEN_OFF, reason)
