"""TODO optimal/parallel.py."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import joblib

from flatgym.scenarios.scenario import Scenario

BACKENDS = ("loky", "ray")
PATIENCE = 2.0
"""How long a batch runs before it shows a bar [s]."""
WAVE = 8
"""Tasks of each Ray worker in a wave."""
Progress = bool | Callable[[int, int], None]


def _check_workers(jobs: int, backend: str) -> None:
    if backend not in BACKENDS:
        raise ValueError(f"unknown backend {backend!r}; known: {', '.join(BACKENDS)}")
    if isinstance(jobs, bool) or not isinstance(jobs, int) or jobs == 0:
        raise ValueError(f"jobs must be a number of processes, or -1 for one a core, got {jobs!r}")


def unordered(attempt: Callable[[Scenario], Any], left: list[Scenario], jobs: int, backend: str) -> Iterator[Any]:
    """Yield the answers as they come: one by one, or in waves from Ray, which hands out nothing before all is done."""
    calls = [joblib.delayed(attempt)(task) for task in left]
    if backend == "loky":
        with joblib.parallel_config(backend=backend, inner_max_num_threads=1):
            yield from joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(calls)
        return
    _register_ray()
    with joblib.parallel_config(backend=backend):
        size = WAVE * joblib.effective_n_jobs(jobs)
        for begin in range(0, len(calls), size):
            yield from joblib.Parallel(n_jobs=jobs)(calls[begin : begin + size])


def _register_ray() -> None:
    try:
        from ray.util.joblib import register_ray
    except ImportError:
        raise ImportError('backend="ray" needs Ray; run: pip install "ray>=2.60"') from None
    register_ray()  # type: ignore[no-untyped-call]


def _watched(found: Iterator[Any], total: int, progress: Progress) -> Iterator[Any]:
    """Pass answers on and show how many there are, on a terminal once it has taken a while."""
    if callable(progress) or not (progress and total and sys.stderr.isatty()):
        for done, answer in enumerate(found, start=1):
            yield answer
            if callable(progress):
                progress(done, total)
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    begun = time.monotonic()
    bar = Bar(console=Console(stderr=True))
    work = bar.add_task("scenarios", total=total)
    try:
        for answer in found:
            yield answer
            bar.advance(work)
            if time.monotonic() - begun > PATIENCE:
                bar.start()
    finally:
        bar.stop()
