"""Foreign code in a process of its own: it may crash or hang without taking anybody along.

    guarded("experiments.benchmark.submission:scored", contest, seconds=60.0)

A function of ours is named by its module, its arguments and its answer are JSON, and what foreign code prints goes to
standard error.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from flatgym.files import write_text

BEGINNING = 120.0
"""How long a new process may take to import what it needs [s]; a busy machine is slow at that."""
PAUSE = 0.02
"""Between two looks at what the process has written [s]."""
ASKED, BEGUN, ANSWER = "asked.json", "begun", "answer.json"


class Failed(ValueError):
    """What ran in a process of its own failed, hung or crashed."""


def run_isolated(function: str, *arguments: Any, seconds: float, home: Path | None = None) -> Any:
    """Return what a function returns that is run in a new process.

    Args:
        function: "module:name".
        arguments: as JSON holds them.
        seconds: how long it may take, once all is imported [s].
        home: the process's working directory; by default the present one.

    Raises:
        Failed: where it raises, takes longer, or ends its process.
    """
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_text(folder / ASKED, json.dumps([function, arguments]))
        command = [
            sys.executable,
            "-P",
            "-c",
            "from experiments.benchmark.sandbox import main; main()",
            name,
        ]  # not what lies about here
        process = subprocess.Popen(command, cwd=home, stdin=subprocess.DEVNULL, stdout=sys.__stderr__)
        try:
            if not _there(folder / BEGUN, process, BEGINNING) or not _there(folder / ANSWER, process, seconds):
                raise Failed(f"no answer within {seconds:g} s; --timeout grants more")
        finally:
            process.kill()
            process.wait()
        if not (folder / ANSWER).exists():
            raise Failed(f"its process ended without an answer, with exit code {process.returncode}")
        answer = json.loads((folder / ANSWER).read_text(encoding="utf-8"))
    if "error" in answer:
        raise Failed(answer["error"])
    return answer["value"]


def _there(path: Path, process: subprocess.Popen[bytes], seconds: float) -> bool:
    """Wait for a file, or for the end of the process; return False where neither came in time."""
    until = time.monotonic() + seconds
    while not path.exists() and process.poll() is None:
        if time.monotonic() > until:
            return False
        time.sleep(PAUSE)
    return True


def main() -> None:
    """Answer what is asked in a folder."""
    folder = Path(sys.argv[1])
    name, arguments = json.loads((folder / ASKED).read_text(encoding="utf-8"))
    module, _, function = name.partition(":")
    call = getattr(import_module(module), function)
    (folder / BEGUN).touch()
    try:
        answer = {"value": call(*arguments)}
    except Exception as error:
        answer = {"error": f"{type(error).__name__}: {error}"}
    write_text(folder / ANSWER, json.dumps(answer))
