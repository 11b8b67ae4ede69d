"""Resident memory of the environments over 10^8 steps: NumPy's compiled kernels, PyTorch and JAX.

Each case has a new process. In a used process a leak could fill memory that earlier work has freed.
"""

from __future__ import annotations

import resource
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from experiments.files import Row
from experiments.measurements.interleaved import Candidate, batch
from experiments.measurements.libraries.one_core import in_new_process
from experiments.measurements.libraries.speed import jax_batch, torch_batch
from experiments.measurements.sections import Advance

STEPS, WARM_UP, ENVS = 100_000_000, 1_000_000, 4096
MAX_GROWTH = 1.0
"""Largest growth of the resident memory that passes [MB]; the allocator keeps a few pages."""


def kernels(envs: int, scenario: str, mode: str) -> Candidate:
    """Return the compiled kernels on a scenario, in an autoreset mode."""
    return batch(scenario, envs, id="FlatQuad-v0", scenario=scenario, autoreset_mode=mode)


CASES: tuple[tuple[str, Callable[..., Candidate], tuple[str, ...]], ...] = (
    ("NextStep", kernels, ("hoop", "NextStep")),
    ("SameStep", kernels, ("random-hoops", "SameStep")),
    ("SameStep", torch_batch, ("float32",)),
    ("SameStep", jax_batch, ("float32",)),
)
"""The autoreset mode of each case, and what makes its candidate."""
QUICK_CASES = (1, 3)
"""Numbers of the cases at small size: the compiled kernels and JAX."""


def memory(quick: bool, advance: Advance) -> list[Row]:
    """Does the resident memory grow over 10^8 steps? Largest growth after the first 10^6 steps."""
    steps, warm_up, envs = (4_000, 2_000, 64) if quick else (STEPS, WARM_UP, ENVS)
    marks = [warm_up, *(steps * share // 10 for share in range(1, 11))]
    rows: list[Row] = []
    for i in QUICK_CASES if quick else range(len(CASES)):
        mode, *_ = CASES[i]
        what, sizes = in_new_process(__name__, f"checkpoints({i}, {envs}, {marks})")
        growth = max(size["resident_mb"] for size in sizes[1:]) - sizes[1]["resident_mb"]
        row: Row = {"what": what, "num_envs": envs, "autoreset": mode, "checkpoints": sizes, "growth_mb": growth}
        rows.append(row | {"metric": "growth_mb", "target": MAX_GROWTH, "passed": growth <= MAX_GROWTH})
        advance(i + 1, len(CASES))
    return rows


def checkpoints(case: int, envs: int, marks: Sequence[int]) -> tuple[str, list[Row]]:
    """Return the name of a case's candidate, and the resident memory at the marks while it runs."""
    _, make, arguments = CASES[case]
    candidate = make(envs, *arguments)
    return candidate.what, resident_at(candidate, marks)


def resident_at(candidate: Candidate, marks: Iterable[int]) -> list[Row]:
    """Run a candidate and return the resident memory before the first step and after each number of steps."""
    sizes, done = [{"env_steps": 0, "resident_mb": resident()}], 0
    for mark in marks:
        while done < mark:
            done += candidate.play()
        sizes.append({"env_steps": done, "resident_mb": resident()})
    return sizes


def resident() -> float:
    """Return the resident memory of this process [MB]; without /proc, its maximum so far."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except FileNotFoundError:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak / (1e6 if sys.platform == "darwin" else 1e3)  # bytes on macOS, kilobytes elsewhere
    return pages * resource.getpagesize() / 1e6
