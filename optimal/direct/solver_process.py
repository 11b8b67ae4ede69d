"""Calls of the solver in a process of its own, which ends itself when a call does not return.

    caller                                            solver process
    call(program, (shape, warm), x0=..., ...)  --->   program(shape, warm)(x0=..., ...)
                                   Called      <---   or the end of the process, after LIMIT seconds or more

While fatrop's factorisation finds a Hessian indefinite, it adds a growing multiple of the identity, until that
overflows, and it then never returns. No limit of iterations, no callback and no signal handler is reached there.
A process can be ended in any state. The caller only waits on a pipe, so an interrupt by the user acts at once.

A call costs 0.3 ms beyond the solver's own time. The process builds each program once and keeps it. It is started by
the first call and serves all threads of its parent, one after the other. It reads nothing of the parent's main module,
may be started by daemonic processes too, and ends when the parent does.
"""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np

from flatgym.quadrotor import Array

LIMIT, LIMIT_PER_UNKNOWN = 5.0, 5e-3
"""Time after which a call counts as lost, and the same per unknown of its program, whichever is longer [s]. With all
iterations a call takes 0.5 ms per unknown on an idle machine."""
MOST_LOST = 2
"""Most lost calls of one task; the next one ends the task."""
COMMAND = "import sys; from optimal.direct.solver_process import serve; serve(int(sys.argv[1]))"


class Called(NamedTuple):
    """The result of one call of a solver.

    Attributes:
        x: the unknowns; the guess if the call is lost.
        multipliers: of the constraints.
        converged: whether the solver reached its tolerances.
        message: the solver's own status, or why there is none.
        iterations: of the solver.
    """

    x: Array
    multipliers: Array
    converged: bool
    message: str
    iterations: int


class SolverLost(RuntimeError):
    """More than MOST_LOST calls of one task did not return."""


class LostCalls(list[float]):
    """The time limits of a task's calls that did not return [s]."""

    def __str__(self) -> str:
        """Return what was lost as a sentence; empty if every call returned."""
        return f"{len(self)} of the solver's calls did not return within {max(self):g} s." if self else ""


_lost: ContextVar[LostCalls | None] = ContextVar("lost", default=None)


@contextlib.contextmanager
def lost_calls() -> Iterator[LostCalls]:
    """Collect the calls of one task that do not return; the first one beyond MOST_LOST raises SolverLost."""
    lost = LostCalls()
    token = _lost.set(lost)
    try:
        yield lost
    finally:
        _lost.reset(token)


def call(build: Callable[..., Any], arguments: tuple[Any, ...], **values: Array) -> Called:
    """Call a solver in the solver process.

    Args:
        build: a function of a module that returns the solver, and keeps it.
        arguments: its arguments.
        values: initial guess, bounds and parameters of the solver, by their names there.

    Returns:
        The result; without convergence if the solver did not return in time.

    Raises:
        SolverLost: inside `lost_calls`, when too many calls of a task did not return.
        RuntimeError: when the process ends for another reason.
        Exception: whatever `build` or the solver raises.
    """
    limit = max(LIMIT, LIMIT_PER_UNKNOWN * len(values["x0"]))
    answer = _process.ask((build, arguments, values, limit))
    if isinstance(answer, Called):
        return answer
    if answer != -signal.SIGALRM:
        raise RuntimeError(f"the solver process ended with exit code {answer}; run again, with more free memory")
    lost = _lost.get()
    if lost is not None:
        lost.append(limit)
        if len(lost) > MOST_LOST:
            raise SolverLost(str(lost))
    return Called(values["x0"], np.zeros(len(values["lbg"])), False, str(LostCalls([limit])), 0)


class SolverProcess:
    """The solver process as its parent sees it; it is started when it is needed."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.running: tuple[subprocess.Popen[bytes], Connection] | None = None

    def ask(self, question: Any) -> Called | int:
        """Return the answer to a question, or the exit code of a process that ended instead."""
        with self.lock:
            process, channel = self.running or self._start()
            try:
                channel.send(question)
                answer = channel.recv()
            except (EOFError, ConnectionError):
                self.running = None
                channel.close()
                return process.wait()
            except BaseException:  # an interrupt; the answer under way would be taken for the next one
                self.end()
                raise
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _start(self) -> tuple[subprocess.Popen[bytes], Connection]:
        channel, theirs = Pipe()
        # The child sees the modules that this process sees, and no others. Its own group keeps Ctrl-C from it.
        places = os.pathsep.join(os.path.abspath(place) for place in sys.path)
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", COMMAND, str(theirs.fileno())],
            env=os.environ | {"PYTHONPATH": places},
            stdin=subprocess.DEVNULL,
            pass_fds=[theirs.fileno()],
            process_group=0,
        )
        theirs.close()
        self.running = process, channel
        return self.running

    def end(self) -> None:
        """End the process, whatever it does."""
        if self.running is not None:
            process, channel = self.running
            self.running = None
            process.kill()
            process.wait()
            channel.close()

    def forget(self) -> None:
        """Leave the process to the parent, in a child of a fork."""
        self.lock = threading.Lock()
        if self.running is not None:
            process, channel = self.running
            self.running, process.returncode = None, 0
            channel.close()


_process = SolverProcess()
atexit.register(_process.end)
os.register_at_fork(after_in_child=_process.forget)


def serve(descriptor: int) -> None:
    """Answer questions of the parent until it ends.

    Signals without a handler end the process, whatever the solver does: that of a timer, and, on Linux, the one that
    reports that the parent has closed its end of the channel.
    """
    for number in (signal.SIGALRM, signal.SIGIO):
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGALRM, signal.SIGIO])
    channel = Connection(descriptor)
    fcntl.fcntl(descriptor, fcntl.F_SETOWN, os.getpid())
    flags = fcntl.fcntl(descriptor, fcntl.F_GETFL)
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            build, arguments, values, limit = channel.recv()
            answer: Called | Exception
            try:
                run = build(*arguments)
                fcntl.fcntl(descriptor, fcntl.F_SETFL, flags | os.O_ASYNC)
                signal.setitimer(signal.ITIMER_REAL, limit)
                answer = _called(run, values)
            except Exception as error:
                answer = error
            signal.setitimer(signal.ITIMER_REAL, 0)
            fcntl.fcntl(descriptor, fcntl.F_SETFL, flags)
            channel.send(answer)


def _called(run: Any, values: dict[str, Array]) -> Called:
    result = run(**values)
    stats = run.stats()
    return Called(
        x=np.array(result["x"]).ravel(),
        multipliers=np.array(result["lam_g"]).ravel(),
        converged=stats["success"],
        message=stats["unified_return_status"],
        iterations=stats["iter_count"],
    )
