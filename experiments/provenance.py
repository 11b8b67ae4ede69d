"""Provenance of a results file: command, date, versions, machine, and the commit of the code that ran."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import joblib

from agents.evaluation.versions import versions
from experiments.files import ROOT, SCHEMA

CPU_INFO = Path("/proc/cpuinfo")
SMALL_SIZES = "Small sizes, only to see that it runs: the numbers mean nothing."


def provenance(command: str) -> dict[str, Any]:
    """Return the first entries of every results file.

    Args:
        command: the command line that writes the file.
    """
    return {
        "schema": SCHEMA,
        "command": command,
        "date": now(),
        "versions": versions(),
        "machine": machine(),
        "processor": processor(),
        "commit": commit(),
    }


def provenance_sentence(
    results: dict[str, Any],
    packages: Iterable[str] = (),
    *,
    command: str = "",
    dates: Iterable[str] = (),
) -> str:
    """Return command, machine, date and versions of a results file as one sentence.

    Args:
        results: its content; entries that it lacks are left out.
        packages: names of the packages whose versions are stated.
        command: stated instead of the recorded one.
        dates: of the parts of the file, stated instead of the date of the file.
    """
    machine, versions = results.get("machine", {}), results.get("versions", {})
    kind = results.get("processor") or ", ".join(machine[key] for key in ("processor", "system") if key in machine)
    where = f" on {cores(machine)}" + (f" ({kind})" if kind else "") if "cores" in machine else ""
    days = sorted({date[:10] for date in (dates or [results.get("date", "")]) if date})
    when = f", {days[0]}" + (f" to {days[-1]}" if days[1:] else "") if days else ""
    used = ", ".join(f"{name} {versions[name]}" for name in packages if name in versions)
    sentence = f"`{command or results['command']}`{where}{when}" + (f"; {used}." if used else ".")
    return f"{sentence} {SMALL_SIZES}" if results.get("smoke") else sentence


def cores(machine: dict[str, Any]) -> str:
    """Return the number of cores of a machine in words."""
    return f"{machine['cores']} core" + "s" * (machine["cores"] != 1)


def now() -> str:
    """Return the time, to the second, UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def machine() -> dict[str, Any]:
    """Return the kind of processor and system, and the number of usable cores."""
    return {"processor": platform.machine(), "system": platform.system(), "cores": joblib.cpu_count()}


def processor() -> str:
    """Return the name of the processor, or its kind where the system does not state the name."""
    try:
        lines = CPU_INFO.read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def commit() -> str | None:
    """Return the commit of the code, with a plus sign if tracked files differ from it; None outside a clone."""
    head, changes = _git("rev-parse", "HEAD"), _git("status", "--porcelain", "--untracked-files=no")
    return None if head is None else head + ("+" if changes else "")


def _git(*arguments: str) -> str | None:
    if not (ROOT / ".git").exists():  # an installed package, perhaps inside another repository
        return None
    try:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()
