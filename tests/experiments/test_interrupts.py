"""Ctrl-C: whatever the main thread does, the process ends with a sentence, without a traceback or workers."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from experiments.files import ROOT
from experiments.interrupts import STATUS

BEGIN = """
import subprocess, sys, time
from experiments.interrupts import interruptible, keeping
def work():
    print("ready", flush=True)
    time.sleep(60)
with interruptible(), keeping(lambda: "all is kept"):
"""
WORK = {
    "waits": "work()",
    "swallows the interrupt": "\n try: work()\n except KeyboardInterrupt: time.sleep(60)",
    "turns it into another error": "\n try: work()\n except KeyboardInterrupt: raise RuntimeError('solver stopped')",
    "exits as Typer does": "\n try: work()\n except KeyboardInterrupt: sys.exit(1)",
    "compiles or loads code": "\n from numba.core.compiler_lock import global_compiler_lock\n"
    " try:\n  with global_compiler_lock: work()\n except KeyboardInterrupt: pass",
    "is in a destructor": "\n class Owner: __del__ = lambda self: work()\n Owner()\n time.sleep(60)",
    "has a worker": "\n worker = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n work()",
    "computes without Python": "\n import threading\n lock = threading.Lock(); lock.acquire(); print('ready')\n"
    " import ctypes; sys.stdout.flush(); ctypes.CDLL(None).sleep(60); ctypes.CDLL(None).sleep(60)",
}


def started(code):
    """Start Python code that prints a line when it is ready for Ctrl-C."""
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.mark.parametrize("what", WORK)
def test_an_interrupted_process_says_what_is_kept_and_ends(what):
    process = started(BEGIN + " " + WORK[what])
    children = psutil.Process(process.pid).children()
    assert len(children) == (what == "has a worker")
    begun = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert time.monotonic() - begun < 2
    assert (process.returncode, err) == (STATUS, "interrupted: all is kept\n")
    assert psutil.wait_procs(children, timeout=5)[1] == []


def test_a_second_interrupt_does_not_disturb_the_first():
    process = started(BEGIN + " try: work()\n finally: time.sleep(0.5)")
    for _ in range(5):
        process.send_signal(signal.SIGINT)
        time.sleep(0.05)
    _, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (STATUS, "interrupted: all is kept\n")


def test_work_that_ends_in_spite_of_the_interrupt_is_done():
    process = started(BEGIN + " try: work()\n except KeyboardInterrupt: print('done')\n")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out, err) == (0, "done\n", "")
