"""The measurement of memory finds a leak."""

import mmap

from experiments.measurements.interleaved import Candidate
from experiments.measurements.libraries import memory
from experiments.measurements.libraries.memory import resident, resident_at


def test_a_leak_is_found():
    kept = []

    def play():
        pages = mmap.mmap(-1, 16_000_000)  # fresh pages: an allocator may hand out memory that is resident already
        pages.write(bytes(len(pages)))
        kept.append(pages)
        return 1

    first, *_, last = resident_at(Candidate("leak", 1, play), [2, 10])
    assert last["env_steps"] == 10
    assert last["resident_mb"] - first["resident_mb"] > 40 * memory.MAX_GROWTH


def test_without_proc_the_peak_is_returned(monkeypatch):
    now = resident()
    monkeypatch.setattr(memory.Path, "read_text", lambda *_, **__: (_ for _ in ()).throw(FileNotFoundError()))
    assert resident() > 0.9 * now
