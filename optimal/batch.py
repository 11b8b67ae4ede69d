"""Many scenarios at once, on all cores or on a cluster; an interrupted batch resumes from its store.

Every scenario is one task with its own seeds. Its answer depends neither on the number of workers nor on the other
scenarios. Workers are processes; each builds the program of a shape once and keeps it. Scenarios with similar programs
are adjacent in the queue. Answers are returned in the order of the scenarios. With a store, each answer is written as
soon as it is finished.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from flatgym.scenarios.catalogue import ScenarioLike, scenario
from flatgym.scenarios.scenario import Scenario
from optimal.discrete.fewest_steps import FewestSteps, fewest_steps
from optimal.flights.solution import Solution, Status
from optimal.minimum_time import solve
from optimal.parallel import Progress, check_workers, unordered, with_progress
from optimal.store import Store

BATCH_DEFAULTS: dict[str, dict[str, Any]] = {"solve": {"max_gap": None}, "fewest_steps": {"time_budget": 0.0}}
"""Options whose default differs in a batch: no proofs, because they take as long as everything else."""

AnswerT = TypeVar("AnswerT", Solution, FewestSteps)


def solve_many(
    scenarios: Iterable[ScenarioLike],
    *,
    jobs: int = -1,
    backend: str = "loky",
    store: str | Path | None = None,
    progress: Progress = True,
    **options: Any,
) -> list[Solution]:
    """Return the answer of `optimal.solve` for every scenario, in their order.

    A failed scenario has an answer too, with status and reason, and does not stop the others.

    Args:
        scenarios: scenarios or their names.
        jobs: worker processes; -1 is one for each core.
        backend: "loky" for processes of this machine, "ray" for a Ray cluster: the running one, the one that the
            environment variable RAY_ADDRESS names, or else a new one on this machine.
        store: a folder of finished answers; answers found there are not computed again; shooting only.
        progress: whether to show a bar on a terminal, or a function of the numbers of finished and of all scenarios.
        options: of `optimal.solve`, except raise_on_failure; lower bounds are proven only if max_gap is given.

    Raises:
        ValueError: for an unknown scenario, an unknown option, or a store for another method.
        ImportError, ConnectionError, RuntimeError: for backend="ray", as in `optimal.parallel.unordered`.
        OSError: when an answer cannot be written; names the file. Earlier answers stay in the store.
    """
    if store is not None and options.get("method", "shooting") != "shooting":
        raise ValueError(
            f"a store keeps flights of method='shooting' only, got {options['method']!r}; leave out store="
        )
    return _many(solve, Solution, scenarios, options, jobs, backend, store, progress)


def fewest_steps_many(
    scenarios: Iterable[ScenarioLike],
    *,
    jobs: int = -1,
    backend: str = "loky",
    store: str | Path | None = None,
    progress: Progress = True,
    **options: Any,
) -> list[FewestSteps]:
    """Return the answer of `optimal.fewest_steps` for every scenario, in their order; see `solve_many`.

    It is proven that fewer steps are impossible only if time_budget is given.
    """
    return _many(fewest_steps, FewestSteps, scenarios, options, jobs, backend, store, progress)


def _many(
    solver: Callable[..., AnswerT],
    answer_type: type[AnswerT],
    scenarios: Iterable[ScenarioLike],
    options: dict[str, Any],
    jobs: int,
    backend: str,
    store: str | Path | None,
    progress: Progress,
) -> list[AnswerT]:
    tasks = [scenario(problem) for problem in scenarios]
    options = _checked_options(solver, options)
    check_workers(jobs, backend)
    stored = None if store is None else Store(store, {"ask": solver.__name__, "options": options})
    answers: dict[Scenario, Any] = {}
    for task in dict.fromkeys(tasks):
        if stored is not None and (answer := stored.read(task)) is not None:
            answers[task] = answer
    left = sorted((task for task in dict.fromkeys(tasks) if task not in answers), key=_program_key)
    found = unordered(partial(_attempt, solver, answer_type, options), left, jobs, backend) if left else iter(())
    for answer in with_progress(found, len(left), progress):
        answers[answer.scenario] = answer
        # An interrupted computation is tried again in the next run.
        if stored is not None and answer.status is not Status.INTERRUPTED:
            stored.write(answer)
    return [answers[task] for task in tasks]


def _checked_options(solver: Callable[..., Any], options: dict[str, Any]) -> dict[str, Any]:
    """Return the options of a solver with its defaults filled in, as plain data.

    Raises:
        ValueError: for an unknown option.
    """
    parameters = inspect.signature(solver).parameters
    known = {name: parameters[name].default for name in parameters if name not in ("problem", "raise_on_failure")}
    known |= BATCH_DEFAULTS[solver.__name__]
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise ValueError(f"unknown options {', '.join(unknown)}; {solver.__name__} has {', '.join(known)}")
    filled = known | options
    return {name: list(value) if isinstance(value, (tuple, range)) else value for name, value in filled.items()}


def _program_key(task: Scenario) -> tuple[int, bool, float]:
    """Return a sort key by which scenarios with similar programs are adjacent: hoops, height limits, distance [m]."""
    return len(task.hoops), task.floor is None and task.ceiling is None, math.dist(task.start, task.goal)


def _attempt(
    solver: Callable[..., AnswerT], answer_type: type[AnswerT], options: dict[str, Any], task: Scenario
) -> AnswerT:
    """Solve one scenario; an error becomes an answer."""
    try:
        return solver(task, raise_on_failure=False, **options)
    except Exception as error:
        return answer_type.failed(task, Status.INTERRUPTED, f"{type(error).__name__}: {error}")
