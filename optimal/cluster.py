"""A map over many tasks on a Ray cluster. The tasks of a lost machine run again on the others.

A task returns to this process, which alone writes files, so the machines need no shared folder. Ray repeats a task, up
to three times, when its machine or its process is lost, also when only its answer is lost with the machine.
"""

from __future__ import annotations

import logging
import os
import socket
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any
from urllib.parse import urlsplit

from flatgym.extras import require

TASKS_PER_CORE = 2
"""Tasks that are given to the cluster at a time, for each of its cores: one runs while the next one waits."""
CONNECTION_LIMIT = 5.0
"""Time for the head of the cluster to answer [s]. Ray itself waits for minutes."""


def unordered_on_cluster(function: Callable[[Any], Any], tasks: Sequence[Any], jobs: int) -> Iterator[Any]:
    """Yield function(task) of all tasks in the order in which they finish; arguments and errors as of `unordered`."""
    ray = connect()

    def run_task(task: Any) -> Any:
        return function(task)  # Ray takes no functools.partial

    remote, left = ray.remote(run_task), deque(tasks)
    running: dict[Any, Any] = {}
    try:
        while left or running:
            while left and len(running) < _capacity(ray, jobs):
                task = left.popleft()
                running[remote.remote(task)] = task
            (answer,), _ = ray.wait(list(running))
            task = running.pop(answer)
            try:
                found = ray.get(answer)
            except ray.exceptions.RayTaskError:  # the function's own error, which it is an instance of
                raise
            except ray.exceptions.RayError as error:
                raise RuntimeError(f"the cluster could not compute {repr(task)[:200]}: {error}") from error
            yield found
    finally:
        for answer in running:
            ray.cancel(answer, force=True)


def connect() -> Any:
    """Return Ray, connected to the cluster of RAY_ADDRESS, to the running one, or to a new one on this machine.

    Raises:
        ImportError: without Ray, with the command that installs it.
        ConnectionError: if no cluster answers at RAY_ADDRESS.
    """
    require("cluster", "ray")
    import ray

    if not ray.is_initialized():
        _check_address(os.environ.get("RAY_ADDRESS", ""))
        # What workers print would mix with the progress bar, and with tables on standard output.
        ray.init(log_to_driver=False, logging_level=logging.WARNING)
    return ray


def _check_address(address: str) -> None:
    """Raise a ConnectionError if an address, host:port or ray://host:port, does not answer."""
    place = urlsplit(address if "//" in address else f"//{address}")
    if not place.port:
        return  # nothing, "auto" or "local"
    try:
        socket.create_connection((place.hostname, place.port), CONNECTION_LIMIT).close()
    except OSError as error:
        raise ConnectionError(
            f"no Ray cluster answers at RAY_ADDRESS={address} ({error}); start one with `ray start --head`, or unset "
            "the variable for one on this machine"
        ) from error


def _capacity(ray: Any, jobs: int) -> int:
    """Return how many tasks the cluster may have at a time; its cores are counted anew, as machines come and go."""
    return jobs if jobs > 0 else TASKS_PER_CORE * max(1, int(ray.cluster_resources().get("CPU", 0)))
