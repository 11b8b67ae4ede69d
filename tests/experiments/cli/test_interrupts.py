"""Ctrl-C at any moment of any command: no traceback, no workers left, and what was written is whole."""

import json
import os
import random
import signal
import subprocess
import sys
import time

import psutil
import pytest

from experiments.files import ROOT
from experiments.interrupts import STATUS

SCRIPT = "from experiments.cli.app import main\n\nif __name__ == '__main__':\n    main()\n"
SLOW = "import time\n\n\ndef policy(seen):\n    time.sleep(0.05)\n    return 0 * seen[:, :2]\n"
COMMANDS = {
    "solve": ("solve", "slalom", "--steps", "--proof-time", "60", "--out", "slalom.csv"),
    "demos": ("demos", "random-goal", "-n", "500"),
    "train": ("train", "hoop", "--folder", "run"),
    "evaluate": ("evaluate", "slow.py:policy", "--scenario", "random-goal"),
    "benchmark": ("benchmark", "--quick", "--policy", "slow=slow:policy"),
}
LIMIT = 2.0
"""Time from the signal to the end of the process [s]."""


def interrupted(folder, moments):
    """Start all commands at once, interrupt each at its moment, and yield how it ended.

    Half of the signals go to the process group, as a terminal sends them, the others to the process alone.

    Args:
        folder: working directories and datasets.
        moments: time of the signal after the start [s] for each of COMMANDS.
    """
    (folder / "flatquad").write_text(SCRIPT)
    begun, running = time.monotonic(), {}
    for name, arguments in COMMANDS.items():
        (home := folder / name).mkdir()
        (home / "slow.py").write_text(SLOW)
        running[name] = subprocess.Popen(
            [sys.executable, str(folder / "flatquad"), *arguments],
            cwd=home,
            env=os.environ | {"PYTHONPATH": str(ROOT), "MINARI_DATASETS_PATH": str(home), "XDG_CACHE_HOME": str(home)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
    for number, (name, moment) in enumerate(sorted(moments.items(), key=lambda pair: pair[1])):
        process = running[name]
        time.sleep(max(0.0, begun + moment - time.monotonic()))
        workers = psutil.Process(process.pid).children(recursive=True)
        signalled = time.monotonic()
        os.killpg(process.pid, signal.SIGINT) if number % 2 else process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
        yield name, process.returncode, time.monotonic() - signalled, err, psutil.wait_procs(workers, timeout=5)[1]


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """How each command ended, and the folder in which it ran."""
    folder, rng = tmp_path_factory.mktemp("interrupted"), random.Random(5)
    moments = {name: rng.uniform(1.0, 9.0) for name in COMMANDS}
    return {name: (*rest, folder / name) for name, *rest in interrupted(folder, moments)}


@pytest.mark.parametrize("name", COMMANDS)
def test_an_interrupted_command_ends_at_once_with_a_sentence_and_without_orphans(ended, name):
    status, seconds, err, workers, _ = ended[name]
    assert status == STATUS
    assert seconds < LIMIT
    assert [line for line in err.splitlines() if "compiling" not in line][-1].startswith("interrupted: ")
    assert not any(word in err for word in ("Traceback", "Error", "Exception"))
    assert workers == []


def test_what_interrupted_commands_have_written_is_whole(ended):
    for *_, folder in ended.values():
        for path in folder.rglob("[!.]*.json"):
            json.loads(path.read_text())
        assert not list(folder.rglob("*.set-aside"))
