"""A map over many tasks, on the cores of this machine (joblib's loky) or on a Ray cluster, with a progress bar."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Any

import joblib

from flatgym.scenarios.scenario import Scenario
from flatgym.validation import choice
from optimal.cluster import unordered_on_cluster

BACKENDS = ("loky", "ray")
BAR_DELAY = 2.0
"""Time after which a batch shows a progress bar [s]."""
Progress = bool | Callable[[int, int], None]
"""Whether to show a bar on a terminal, or a function that takes the number of finished tasks and of all tasks."""


def check_workers(jobs: int, backend: str) -> None:
    """Raise a ValueError for an unknown backend or an impossible number of workers."""
    choice("backend", backend, BACKENDS)
    if isinstance(jobs, bool) or not isinstance(jobs, int) or jobs == 0:
        raise ValueError(f"jobs must be a number of processes, or -1 for one a core, got {jobs!r}")


def unordered(function: Callable[[Scenario], Any], tasks: list[Scenario], jobs: int, backend: str) -> Iterator[Any]:
    """Yield function(task) of all tasks in the order in which they finish.

    Args:
        function: must be picklable.
        tasks: its arguments, at least one.
        jobs: worker processes; -1 is one for each core.
        backend: one of BACKENDS.

    Raises:
        ImportError: for backend="ray" without Ray.
        ConnectionError: for backend="ray" if no cluster answers at RAY_ADDRESS.
        RuntimeError: for a task that ends its process on the cluster each time it is tried.
    """
    if backend == "ray":
        yield from unordered_on_cluster(function, tasks, jobs)
        return
    calls = [joblib.delayed(function)(task) for task in tasks]
    with joblib.parallel_config(backend=backend, inner_max_num_threads=1):
        yield from parallel_results(calls, jobs, "generator_unordered")


def parallel_results(calls: Iterable[Any], jobs: int, return_as: str = "generator") -> Iterator[Any]:
    """Return the results of joblib's delayed calls, from worker processes that Ctrl-C does not reach.

    A terminal sends Ctrl-C to all processes. Only the parent needs it: it ends the workers, which would otherwise print
    tracebacks. A process inherits the signals that its parent blocks while it is started.
    """
    with blocked_interrupts():
        found: Iterator[Any] = joblib.Parallel(n_jobs=jobs, return_as=return_as)(calls)
    return found


@contextmanager
def blocked_interrupts() -> Iterator[None]:
    """Block Ctrl-C in this thread, and for good in processes and threads that are started within this context."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # pools start it, and before Python 3.13 its start unblocks the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def with_progress(found: Iterator[Any], total: int, progress: Progress) -> Iterator[Any]:
    """Yield the items of an iterator and report progress: to a function, or as a bar on a terminal after BAR_DELAY."""
    if callable(progress) or not (progress and total and sys.stderr.isatty()):
        for done, item in enumerate(found, start=1):
            yield item
            if callable(progress):
                progress(done, total)
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    begun = time.monotonic()
    bar = Bar(console=Console(stderr=True))
    work = bar.add_task("scenarios", total=total)
    try:
        for item in found:
            yield item
            bar.advance(work)
            if time.monotonic() - begun > BAR_DELAY:
                bar.start()
    finally:
        bar.stop()
