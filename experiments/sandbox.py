"""External code in a process of its own: it may print, hang, exit or crash without harm to the caller.

    run_isolated("experiments.scoring.submission:fly_fields", fields, None, seconds=60.0)

The function is named by its module; arguments and result are JSON. The child process sends two lines through a pipe:
the first when all is imported, the second with the result. What external code prints goes to standard error.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import IO, Any

IMPORT_TIMEOUT = 120.0
"""Time limit for the imports of a new process [s]; they are slow on a busy machine."""
MAIN = "from experiments.sandbox import main; main()"
Lines = SimpleQueue[str | None]


class Failed(ValueError):
    """The isolated function raised an error, took too long, or its process ended."""


def run_isolated(function: str, *arguments: Any, seconds: float, home: Path | None = None) -> Any:
    """Call a function in a new process and return its result.

    Args:
        function: "module:name".
        arguments: JSON values.
        seconds: time limit after the imports [s].
        home: working directory of the process; by default the present one.

    Raises:
        Failed: where the function raises an error, takes longer, or ends its process.
    """
    # -P: modules in the working directory do not replace installed ones.
    command = [sys.executable, "-P", "-c", MAIN, json.dumps([function, arguments])]
    process = subprocess.Popen(
        command, cwd=home, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, start_new_session=True
    )  # a session of its own: Ctrl-C is for the caller, which ends this process
    lines: Lines = SimpleQueue()
    Thread(target=_read, args=(process.stdout, lines), daemon=True).start()
    try:
        answer = lines.get(timeout=IMPORT_TIMEOUT) and lines.get(timeout=seconds)
        if not answer:
            process.wait(seconds)  # for its own exit code
    except (Empty, subprocess.TimeoutExpired):
        raise Failed(f"no answer within {seconds:g} s; --timeout grants more") from None
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)  # with the workers that it may have started
        process.wait()
    if not answer:
        raise Failed(f"its process ended without an answer, with exit code {process.returncode}")
    result = json.loads(answer)
    if "error" in result:
        raise Failed(result["error"])
    return result["value"]


def _read(stream: IO[str], lines: Lines) -> None:
    """Pass on the lines of a pipe, and None at its end."""
    with stream:
        for line in stream:
            lines.put(line)
    lines.put(None)


def main() -> None:
    """Call the function that the command line names; the entry point of the child process."""
    with os.fdopen(os.dup(1), "w") as answers:
        os.dup2(2, 1)  # what external code prints goes to standard error
        name, arguments = json.loads(sys.argv[1])
        module, _, function = name.partition(":")
        call = getattr(import_module(module), function)
        print("imported", file=answers, flush=True)
        try:
            result = {"value": call(*arguments)}
        except Exception as error:
            result = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(result), file=answers, flush=True)
