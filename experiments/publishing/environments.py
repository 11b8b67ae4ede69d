"""The README's table of the environments, from `envs.json`: what was compared with what, and was the bar met?

A row names two that took turns in one process, their speeds, the ratio, and the bar where one was set beforehand.
Ratios are rounded down, so that none seems to reach a bar which it misses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import floor
from textwrap import fill
from typing import Any

from experiments.files import Row
from experiments.publishing.markdown import markdown

HEAD = ["measured", "FlatQuad", "beside", "ratio", "bar", "met"]
BARS = {"median_s": "≤ {:g} s", "compiled": "{:g} compiled again", "growth_mb": "≤ {:g} MB"}
"""How a bar is told, by what it is on; all others are ratios to be reached."""
VERSIONS = ("flatgym", "gymnasium", "numpy", "numba", "stable-baselines3", "torch")


def environments(results: dict[str, Any]) -> str:
    """Return the table, and how it came about."""
    sections = results["sections"]
    lines = [line for name, told in LINES.items() if name in sections for line in told(sections[name]["rows"])]
    return "\n\n".join([markdown(HEAD, lines), fill(conditions(sections), 118, break_on_hyphens=False), told(results)])


def batched(rows: list[Row]) -> Iterator[list[str]]:
    """Yield the batched environment beside its peer, the other scenarios beside the first, and NumPy alone."""
    fast, slow = [row for row in rows if "numba" not in row], [row for row in rows if "numba" in row]
    peer, hoop, drawn, *others = fast
    yield compared(f"batched: {many(hoop)}, beside {many(peer)}", hoop, peer)
    yield compared(f"batched: {many(drawn)}, beside {name(hoop)}", drawn, hoop, "ratio_to_hoop")
    last = min(
        (row for row in others if row["num_envs"] == hoop["num_envs"]), key=lambda row: float(row["ratio_to_hoop"])
    )
    yield compared(f"batched: {many(last)}, the slowest other, beside {name(hoop)}", last, hoop, "ratio_to_hoop")
    for beside, ours in zip(slow[::2], slow[1::2], strict=True):
        yield compared(f"batched, numba missing: {many(ours)}, beside {many(beside)}", ours, beside)


def scalar(rows: list[Row]) -> Iterator[list[str]]:
    """Yield one environment beside one of its peer."""
    peer, ours = rows
    yield compared(f"scalar, `gym.make`: {name(ours)}, beside {name(peer)}", ours, peer)


def sb3(rows: list[Row]) -> Iterator[list[str]]:
    """Yield the adapter beside Stable-Baselines3's own."""
    peer, ours = rows
    yield compared(f"`agents.make_vec_env`: {many(ours)}, beside {many(peer)}", ours, peer)


def ppo(rows: list[Row]) -> Iterator[list[str]]:
    """Yield training beside training, for each size of the minibatches."""
    for peer, ours in zip(rows[::2], rows[1::2], strict=True):
        what = f"PPO end to end, minibatches of {ours['minibatch']:,}: {many(ours)}, beside {many(peer)}"
        yield compared(what, ours, peer)


def imports(rows: list[Row]) -> Iterator[list[str]]:
    """Yield the seconds of an import, and of the first step with and without kernels on disk."""
    by_name = {row["what"]: row for row in rows}
    pairs = {
        "`import flatgym`, beside `import gymnasium`": ("import flatgym", "import gymnasium"),
        "first step of a process, kernels on disk, beside compiling them": (
            "first step, warm cache",
            "first step, cold cache",
        ),
    }
    for what, (ours, beside) in pairs.items():
        seconds = [f"{by_name[key]['median_s']:.2f} s" for key in (ours, beside)]
        yield [what, *seconds, "-", *verdict(by_name[ours])]


def memory(rows: list[Row]) -> Iterator[list[str]]:
    """Yield the growth of the resident memory."""
    for row in rows:
        steps = row["checkpoints"][-1]["env_steps"]
        what = f"growth of the memory in {steps / 1e6:,.3g} M steps: {many(row)}, {row['autoreset']}"
        yield [what, f"{row['growth_mb']:.2f} MB", "-", "-", *verdict(row)]


LINES: dict[str, Callable[[list[Row]], Iterator[list[str]]]] = {
    "batched": batched,
    "scalar": scalar,
    "sb3": sb3,
    "ppo": ppo,
    "imports": imports,
    "memory": memory,
}
"""The lines of a section, in the order of the table."""


def compared(what: str, ours: Row, beside: Row, key: str = "ratio") -> list[str]:
    """Return the line of two speeds and the ratio of the rounds, which is not quite that of the medians."""
    return [what, speed(ours), speed(beside), rounded_down(ours[key]), *verdict(ours)]


def verdict(row: Row) -> list[str]:
    """Return the bar and whether it is met; dashes where there was none."""
    if "bar" not in row:
        return ["-", "-"]
    return [BARS.get(row["bar_on"], "≥ {:g}").format(row["bar"]), "yes" if row["met"] else "no"]


def speed(row: Row) -> str:
    """Return steps a second, in thousands or millions."""
    rate = row["steps_per_s"]
    return f"{rate / 1e6:.2f} M/s" if rate >= 1e6 else f"{rate / 1e3:.1f} k/s"


def rounded_down(ratio: float) -> str:
    """Return a ratio with two decimals, a large one with none."""
    return f"{floor(ratio * 100) / 100:.2f}" if ratio < 10 else f"{floor(ratio):,}"


def name(row: Row) -> str:
    """Return what is flown, set as code where it is ours."""
    return row["what"] if "CartPole" in row["what"] else f"`{row['what']}`"


def many(row: Row) -> str:
    """Return how many fly at once, and what."""
    kind, of, what = str(row["what"]).rpartition(" of ")
    return f"{kind}{of}{row['num_envs']:,} x {name(row | {'what': what})}"


def conditions(sections: dict[str, Any]) -> str:
    """Return how the ratios were taken, and how the speed grows with the number of vehicles."""
    rows = [row for section in sections.values() for row in section["rows"] if "rates" in row]
    words = "Environment steps a second, by random actions except in PPO, ends and resets of episodes included."
    if rows:
        words += (
            " Those compared take turns in one process, and a ratio is the median of those within the rounds; "
            f"at most {max(row['cores'] for row in rows):.1f} cores were busy."
        )
    if "batched" in sections:
        fast = [row for row in sections["batched"]["rows"] if "numba" not in row]
        ladder = sorted((row for row in fast if row["what"] == fast[1]["what"]), key=lambda row: int(row["num_envs"]))
        sizes, speeds = ", ".join(f"{row['num_envs']}" for row in ladder), ", ".join(speed(row) for row in ladder)
        words += f" In batches of {sizes} vehicles, {name(fast[1])} is flown at {speeds}."
    return words


def told(results: dict[str, Any]) -> str:
    """Return command, machine, dates and versions."""
    sections, machine = results["sections"].values(), results["machine"]
    command = "python -m experiments.measurements.environments" + (" --quick" if results["quick"] else "")
    dates = " and ".join(sorted({section["date"][:10] for section in sections}))
    used = ", ".join(f"{part} {results['versions'][part]}" for part in VERSIONS if part in results["versions"])
    small = " Small sizes, only to see that it runs: the numbers mean nothing." if results["quick"] else ""
    where = f"{machine['cores']} cores ({machine['processor']}, {machine['system']})"
    words = f"`{command}` on {where}, {dates}; {used}.{small}"
    return fill(words, 118, break_on_hyphens=False)
