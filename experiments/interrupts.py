"""Ctrl-C: the command ends within two seconds, its worker processes with it, and a sentence says what is kept.

Files are written under a temporary name and then renamed, so an interrupt leaves the old file or the complete new one.
The first signal raises a KeyboardInterrupt in the main thread; later ones are ignored. A thread ends the process if
that takes too long, because the main thread computes in a library or waits for a worker. Nothing is raised while numba
compiles or loads code: its objects do not survive that, and the next call would end in some other error, or in a crash.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Event, Lock, Thread
from typing import Any

import psutil

STATUS = 130
"""Exit status of an interrupted command, 128 + SIGINT as in a shell."""
PATIENCE = 0.6
"""Time that the main thread has to end by itself [s]."""
Kept = str | Callable[[], str]
"""What is kept, and how to go on; or a function that returns it."""
SHOW_CURSOR = "\x1b[?25h"

NOTHING = "nothing more is written; the same command starts over"

_kept: list[Kept] = [NOTHING]
"""What the work in progress keeps, the innermost last."""
_signalled = Event()
"""Set by the first Ctrl-C."""
_ending = Lock()
"""Taken by the thread that ends the process."""


@contextmanager
def keeping(what: Kept) -> Iterator[None]:
    """Within this context an interrupted command says what is kept."""
    _kept.append(what)
    try:
        yield
    finally:
        if not _signalled.is_set():  # else `end` says it
            _kept.pop()


@contextmanager
def interruptible() -> Iterator[None]:
    """Within this context Ctrl-C ends the process with STATUS, a sentence and no traceback; in the main thread only."""
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    handler = signal.signal(signal.SIGINT, _interrupt)
    wakeup = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
    report = sys.unraisablehook
    # An interrupt in a destructor or in a callback from C cannot be raised; the thread ends the process.
    sys.unraisablehook = lambda unraisable: None if _signalled.is_set() else report(unraisable)
    Thread(target=_end_in_time, args=(receiver,), daemon=True).start()
    try:
        yield
    except BaseException as error:
        # Libraries turn the KeyboardInterrupt into other errors, and Typer into an exit.
        if _signalled.is_set() and not (isinstance(error, SystemExit) and not error.code):
            end()
        raise
    finally:
        signal.signal(signal.SIGINT, handler)
        signal.set_wakeup_fd(wakeup)
        sys.unraisablehook = report
        sender.close()


def _interrupt(*_: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C does not interrupt the orderly end
    _signalled.set()
    if not _compiling():
        raise KeyboardInterrupt


def _compiling() -> bool:
    """Return whether this thread compiles or loads code by numba, if numba is imported at all."""
    lock = getattr(sys.modules.get("numba.core.compiler_lock"), "global_compiler_lock", None)
    return lock is not None and lock.is_locked()


def _end_in_time(receiver: socket.socket) -> None:
    """End the process if it still runs PATIENCE after the signal; return when the socket closes."""
    with receiver:
        while received := receiver.recv(1):
            if received[0] == signal.SIGINT:
                time.sleep(PATIENCE)
                end()


def end() -> None:
    """Print what is kept, end the worker processes and this one; Python's own end would take another second."""
    if not _ending.acquire(blocking=False):
        time.sleep(PATIENCE)  # the other thread is at it
        return
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            if "resource_tracker" not in " ".join(child.cmdline()):  # it ends by itself and removes shared memory
                child.kill()
    what = _kept[-1]
    cursor = SHOW_CURSOR if sys.stderr.isatty() else ""
    print(f"{cursor}interrupted: {what() if callable(what) else what}", file=sys.stderr, flush=True)
    os._exit(STATUS)
