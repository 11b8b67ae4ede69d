"""Experiments: the paper's tables, the benchmark of agents, measurements, figures, and the command line."""

import os
import signal
import sys
from multiprocessing import current_process
from pathlib import Path

IS_COMMAND = Path(sys.argv[0]).stem == "flatquad"
"""Whether the process is the command `flatquad`, which shows no tracebacks."""


def _end(*_: object) -> None:
    """End the process at Ctrl-C while it imports; afterwards `experiments.interrupts` does."""
    os.write(2, b"interrupted: nothing is written\n")
    os._exit(128 + signal.SIGINT)


if IS_COMMAND:  # its worker processes import this too
    signal.signal(signal.SIGINT, _end if current_process().name == "MainProcess" else signal.SIG_IGN)

from flatgym.extras import require

try:
    require("experiments", "typer", "rich", "plotly", "pandas", "psutil")
except ImportError as error:
    if IS_COMMAND:
        sys.exit(f"failed: {error}")
    raise
