"""The tables of the chain bound, from `solvers.json` and from the table of best-known solutions.

A section that is not measured yet leaves a sentence in its place.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from experiments.files import Row
from experiments.formats import lower_bound, percent
from experiments.measurements.reference_table import PROOF_TIME
from experiments.publishing.figures.chain import (
    CONVERGENCE,
    EXPLANATION,
    HOOPS,
    convergence_figure,
    explanation,
    hoops_figure,
)
from experiments.publishing.markdown import markdown, paragraph
from experiments.publishing.solvers import measured_by
from flatgym import SCENARIOS, reference
from flatgym.files import write_text

SEEDS_NAMED = 12
"""Most seeds of unproven draws that are listed."""
TRACKS = ("random_tracks", "track_validity", "sampled_steps")
"""Sections of `tracks`."""


def not_measured(section: str) -> str:
    """Return what stands in the place of a section that is not measured."""
    return f"Not measured yet. `flatquad measure solvers {section}` and `flatquad publish` fill this place."


def convergence(results: dict[str, Any]) -> str:
    """Return wall time and evaluations by requested gap."""
    return _measured(
        results,
        "convergence",
        ["scenario", "gap requested", "gap", "wall time [s]", "evaluations of F", "branches"],
        lambda row: [f"`{row['scenario']}`", percent(row["gap_asked"], 2), *work(row)],
        f"![Gap against wall time for hoop, slalom and loop](experiments/results/published/{CONVERGENCE})",
    )


def hoops(results: dict[str, Any]) -> str:
    """Return times and evaluations by number of hoops."""
    return _measured(
        results,
        "hoops",
        [
            *("hoops", "T* upper bound [s]", "lower bound [s]", "gap", "wall time [s]", "evaluations of F", "branches"),
            "processor time [s]",
        ],
        lambda row: [
            f"{row['hoops']}",
            f"{row['upper_bound_s']:.5f}",
            lower_bound(row["lower_bound_s"]),
            *work(row),
            seconds(row["processor_time_s"]),
        ],
        f"![Processor time and evaluations against the number of hoops](experiments/results/published/{HOOPS})",
    )


def work(row: Row) -> list[str]:
    """Return gap, wall time, evaluations and branches of a proof as cells."""
    return [share(row["gap"], 3), seconds(row["wall_time_s"]), f"{row['evaluations']:,}", f"{row['branches']}"]


def seconds(value: float) -> str:
    """Return a time with three significant digits [s]."""
    return f"{value:#.3g}".rstrip(".")


def share(value: float | None, digits: int) -> str:
    """Return a gap as percent, or a word where no bound or no flight gives one."""
    return "unknown" if value is None else percent(value, digits)


def tracks(results: dict[str, Any]) -> str:
    """Return gaps of sampled tracks, validity, and how many sampled scenarios have a proven K*, as paragraphs."""
    sections = results["sections"]
    sentences = {"random_tracks": random_tracks, "track_validity": validity, "sampled_steps": sampled_steps}
    parts = [
        paragraph(sentence(sections[name]["rows"]) if name in sections else not_measured(name))
        for name, sentence in sentences.items()
    ]
    there = [name for name in TRACKS if name in sections]
    return "\n\n".join([*parts, measured_by(results, there)] if there else parts)


def random_tracks(rows: list[Row]) -> str:
    """Return gaps and times of sampled tracks."""
    total = rows[-1]
    return (
        f"Of {total['tracks']} draws of `random-track`, {total['certified']} have a certified flight, and "
        f"{total['checked']} proofs hold when recomputed. With a requested gap of {percent(total['gap_asked'])} and "
        f"{total['budget_s']:.0f} s each, the median gap is {share(total['gap_median'], 2)} at a median of "
        f"{total['wall_time_median_s']:.1f} s. The {total['wide']} draws with a gap above "
        f"{percent(total['wide_gap'])} are proven again with {total['wide_budget_s']:.0f} s. The largest gap is then "
        f"{share(total['gap_worst'], 2)}."
    )


def validity(rows: list[Row]) -> str:
    """Return whether a bound contradicts a flight."""
    total = {key: sum(row[key] for row in rows) for key in ("certified", "above_a_flight", "slower_excluded")}
    return (
        f"Of the bounds of {total['certified']} other sampled tracks of 2 to 6 hoops with {len(rows)} vehicles, "
        f"{total['above_a_flight']} are above the time of a certified flight. A duration 1 % above the flown one was "
        f"excluded {total['slower_excluded']} times."
    )


def sampled_steps(rows: list[Row]) -> str:
    """Return of how many sampled scenarios K* is proven."""
    known = [row for row in rows if row["draws"]]
    parts = [f"{row['proven']} of {row['draws']} draws of `{row['distribution']}`" for row in known]
    unproven = [
        f"{row['gap_steps_worst']} step{'s' * (row['gap_steps_worst'] > 1)} at most for {seeds(row['open_seeds'])} of "
        f"`{row['distribution']}`"
        for row in known
        if row["open_seeds"]
    ]
    proven = f"K* is proven for {', '.join(parts)}."
    if not unproven:
        return proven
    return f"{proven} The proof spent its time budget of {PROOF_TIME:.0f} s with a gap of {', and '.join(unproven)}."


def seeds(numbers: Sequence[int]) -> str:
    """Return the seeds in words, without their numbers where they are many."""
    many = len(numbers) > SEEDS_NAMED
    return f"{len(numbers)} seeds" if many else f"the seeds {', '.join(map(str, numbers))}"


def proven() -> str:
    """Return for how many named scenarios K* is proven, and which are open, from the shipped table."""
    known = {name: best for name in SCENARIOS if (best := reference(name)) is not None}
    unproven = [f"`{name}` ({best.k_star}, ≥ {best.k_lower_bound})" for name, best in known.items() if not best.proven]
    count = len(known) - len(unproven)
    if not unproven:
        return paragraph(f"Yes, for all {count} named scenarios.")
    return paragraph(
        f"For {count} of the {len(known)} named scenarios it is. For the others a lower bound is known, but it does "
        f'not reach K*: {", ".join(unproven)}. There "best known" is the right word.'
    )


def draw(folder: Path, results: dict[str, Any]) -> None:
    """Draw the figures of the measured sections, and the explanation of one chain, as SVG."""
    measured: dict[str, tuple[str, Callable[[list[Row]], Any]]] = {
        "convergence": (CONVERGENCE, convergence_figure),
        "hoops": (HOOPS, hoops_figure),
    }
    for section, (name, figure) in measured.items():
        if section in results["sections"]:
            write_text(folder / name, figure(results["sections"][section]["rows"]).to_image("svg").decode())
    write_text(folder / EXPLANATION, explanation().to_image("svg").decode())


def _measured(
    results: dict[str, Any], section: str, head: list[str], cells: Callable[[Row], list[str]], picture: str
) -> str:
    """Return the table of a section, its picture and its provenance."""
    if section not in results["sections"]:
        return not_measured(section)
    rows = results["sections"][section]["rows"]
    return "\n\n".join([markdown(head, [cells(row) for row in rows]), picture, measured_by(results, (section,))])
