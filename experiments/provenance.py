"""Where a results file comes from: command, date, versions, machine, and the commit of the code that ran."""

from __future__ import annotations

import platform
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import joblib

from agents.evaluation.versions import versions
from experiments.files import SCHEMA

ROOT = Path(__file__).resolve().parent.parent
CPU_INFO = Path("/proc/cpuinfo")


def provenance(command: str) -> dict[str, Any]:
    """Return what every results file begins with; `command` is what the user typed."""
    return {
        "schema": SCHEMA,
        "command": command,
        "date": now(),
        "versions": versions(),
        "machine": machine(),
        "processor": processor(),
        "commit": commit(),
    }


def now() -> str:
    """Return the time, to the second, UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def machine() -> dict[str, Any]:
    """Return the kind of processor and system, and the cores that may be used."""
    return {"processor": platform.machine(), "system": platform.system(), "cores": joblib.cpu_count()}


def processor() -> str:
    """Return the processor's own name, or its kind where the system does not tell."""
    try:
        lines = CPU_INFO.read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()


def commit() -> str | None:
    """Return the commit of the code, with a plus sign where files differ from it; None outside a clone."""
    head, changes = _git("rev-parse", "HEAD"), _git("status", "--porcelain", "--untracked-files=no")
    return None if head is None else head + ("+" if changes else "")


def _git(*arguments: str) -> str | None:
    if not (ROOT / ".git").exists():  # installed, perhaps inside somebody else's repository
        return None
    try:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()
