"""The table of the environments, from `envs.json`: speeds relative to a baseline, and targets.

A line compares FlatQuad with a baseline that was timed in alternation in the same process. It has their speeds, the
ratio, and the target if one was set before the measurement. Ratios are rounded down, so that no rounded ratio passes
a target that the measured one misses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import ceil, floor, log10
from typing import Any

from experiments.files import Row
from experiments.provenance import provenance_sentence
from experiments.publishing.markdown import markdown, paragraph

HEAD = ["measured", "FlatQuad", "baseline", "ratio", "target", "passed"]
TARGETS = {
    "median_s": "≤ {:g} s",
    "compiled": "{:g} compiled again",
    "growth_mb": "≤ {:g} MB",
    "steps_per_s": "≥ {:,.0f}/s",
    "same_share": "share ≥ {:g}",
}
"""Formats of targets by metric; all others are least ratios."""
PACKAGES = ("flatgym", "gymnasium", "numpy", "numba", "stable-baselines3", "torch", "jax")


def environments(results: dict[str, Any]) -> str:
    """Return the table, how the ratios are measured, and the provenance."""
    sections = results["sections"]
    lines = [line for name, write in LINES.items() if name in sections for line in write(sections[name]["rows"])]
    dates = [section["date"] for section in sections.values()]
    command = "flatquad measure environments" + (" --quick" if results["smoke"] else "")
    source = provenance_sentence(results, PACKAGES, command=command, dates=dates)
    return "\n\n".join([markdown(HEAD, lines), paragraph(method(sections)), paragraph(source)])


def batched(rows: list[Row]) -> Iterator[list[str]]:
    """Yield the batched environment against its baseline, other scenarios against the first, and NumPy alone."""
    fast, slow = [row for row in rows if "numba" not in row], [row for row in rows if "numba" in row]
    baseline, hoop, drawn, *others = fast
    yield compared(f"batched: {many(hoop)}, against {many(baseline)}", hoop, baseline)
    yield compared(f"batched: {many(drawn)}, against {name(hoop)}", drawn, hoop, "ratio_to_hoop")
    last = min(
        (row for row in others if row["num_envs"] == hoop["num_envs"]), key=lambda row: float(row["ratio_to_hoop"])
    )
    yield compared(f"batched: {many(last)}, the slowest other, against {name(hoop)}", last, hoop, "ratio_to_hoop")
    for theirs, ours in zip(slow[::2], slow[1::2], strict=True):
        yield compared(f"batched without numba: {many(ours)}, against {many(theirs)}", ours, theirs)


def scalar(rows: list[Row]) -> Iterator[list[str]]:
    """Yield one environment against one of the baseline."""
    baseline, ours = rows
    yield compared(f"scalar, `gym.make`: {name(ours)}, against {name(baseline)}", ours, baseline)


def sb3(rows: list[Row]) -> Iterator[list[str]]:
    """Yield our Stable-Baselines3 adapter against Stable-Baselines3's own."""
    baseline, ours = rows
    yield compared(f"`agents.make_vec_env`: {many(ours)}, against {many(baseline)}", ours, baseline)


def ppo(rows: list[Row]) -> Iterator[list[str]]:
    """Yield training against training, for each minibatch size."""
    for baseline, ours in zip(rows[::2], rows[1::2], strict=True):
        what = f"PPO end to end, minibatches of {ours['minibatch']:,}: {many(ours)}, against {many(baseline)}"
        yield compared(what, ours, baseline)


def imports(rows: list[Row]) -> Iterator[list[str]]:
    """Yield the times of an import, and of the first step with and without stored kernels."""
    by_name = {row["what"]: row for row in rows}
    pairs = {
        "`import flatgym`, against `import gymnasium`": ("import flatgym", "import gymnasium"),
        "first step of a process, kernels stored, against compiling them": (
            "first step, warm cache",
            "first step, cold cache",
        ),
    }
    for what, (ours, theirs) in pairs.items():
        seconds = [f"{by_name[key]['median_s']:.2f} s" for key in (ours, theirs)]
        yield [what, *seconds, "-", *target_cells(by_name[ours])]


def memory(rows: list[Row]) -> Iterator[list[str]]:
    """Yield the growth of the resident memory."""
    for row in rows:
        steps = row["checkpoints"][-1]["env_steps"]
        what = f"memory growth in {steps / 1e6:,.3g} M steps: {many(row)}, {row['autoreset']}"
        yield [what, f"{row['growth_mb']:.2f} MB", "-", "-", *target_cells(row)]


def libraries(rows: list[Row]) -> Iterator[list[str]]:
    """Yield PyTorch and JAX against the compiled kernels."""
    kernels, *others = rows
    for row in others:
        kind, _, what = row["what"].rpartition(" of ")
        yield compared(f"{kind}, one core: {row['num_envs']:,} x `{what}`, against the kernels", row, kernels)


def agreement(rows: list[Row]) -> Iterator[list[str]]:
    """Yield how the flights of each library agree with NumPy's."""
    for row in rows:
        what = f"{row['what']}, {row['precision']}: {row['env_steps']:,} steps on all scenarios, against NumPy"
        alike = f"{row['same']:,} of {row['episodes']:,} episodes alike"
        yield [what, f"{alike}, errors ≤ {rounded_up(row['max_error']):.0e}", "-", "-", *target_cells(row)]


LINES: dict[str, Callable[[list[Row]], Iterator[list[str]]]] = {
    "batched": batched,
    "scalar": scalar,
    "sb3": sb3,
    "ppo": ppo,
    "imports": imports,
    "memory": memory,
    "libraries": libraries,
    "agreement": agreement,
}
"""The lines of each section, in the order of the table."""


def compared(what: str, ours: Row, baseline: Row, key: str = "ratio") -> list[str]:
    """Return the line of two speeds; the ratio is the median within the rounds, not the ratio of the medians."""
    return [what, speed(ours), speed(baseline), rounded_down(ours[key]), *target_cells(ours)]


def target_cells(row: Row) -> list[str]:
    """Return the target and whether it is passed; dashes if there is none."""
    if "target" not in row:
        return ["-", "-"]
    return [TARGETS.get(row["metric"], "≥ {:g}").format(row["target"]), "yes" if row["passed"] else "no"]


def speed(row: Row) -> str:
    """Return steps a second, in thousands or millions."""
    rate = row["steps_per_s"]
    return f"{rate / 1e6:.2f} M/s" if rate >= 1e6 else f"{rate / 1e3:.1f} k/s"


def rounded_down(ratio: float) -> str:
    """Return a ratio with two decimals, from 10 on with none."""
    return f"{floor(ratio * 100) / 100:.2f}" if ratio < 10 else f"{floor(ratio):,}"


def rounded_up(error: float) -> float:
    """Return an error with one digit."""
    unit = 10.0 ** floor(log10(error)) if error > 0 else 1.0
    return ceil(error / unit) * unit


def name(row: Row) -> str:
    """Return the name of an environment or scenario; scenarios are set as code."""
    return row["what"] if "CartPole" in row["what"] else f"`{row['what']}`"


def many(row: Row) -> str:
    """Return the number of environments and their name."""
    kind, of, what = str(row["what"]).rpartition(" of ")
    return f"{kind}{of}{row['num_envs']:,} x {name(row | {'what': what})}"


def method(sections: dict[str, Any]) -> str:
    """Return how the ratios are measured, and the speed by the number of vehicles."""
    rows = [row for section in sections.values() for row in section["rows"] if "rates" in row]
    words = "Environment steps a second with random actions, in PPO with the policy's; resets are included."
    if rows:
        words += (
            " Compared environments alternate in one process, and a ratio is the median of the ratios within the "
            f"rounds; at most {max(row['cores'] for row in rows):.1f} cores were busy."
        )
    if "batched" in sections:
        fast = [row for row in sections["batched"]["rows"] if "numba" not in row]
        ladder = sorted((row for row in fast if row["what"] == fast[1]["what"]), key=lambda row: int(row["num_envs"]))
        sizes, speeds = ", ".join(f"{row['num_envs']}" for row in ladder), ", ".join(speed(row) for row in ladder)
        words += f" In batches of {sizes} vehicles, {name(fast[1])} runs at {speeds}."
    return words
