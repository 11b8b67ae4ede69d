"""TODO experiments/publishing/demonstrations.py."""

from __future__ import annotations

from textwrap import fill

from experiments.benchmark.formats import rounded
from experiments.files import Row
from experiments.publishing.learners import WIDTH
from experiments.publishing.markdown import markdown


def demos(results: Row) -> str:
    """Return how fast demonstrations are made, and how many replay to the goal in as many steps."""
    head = ["section", "flights", "flights a second", "K* proven", "mean steps", "replayed to goal", "kB a flight"]
    rows = [
        [
            f"{name}, `{row['what']}`" if name != row["what"] else f"`{name}`",
            f"{row['flights']:,}",
            f"{row['per_second']:.1f}",
            rounded(row["proven"]),
            f"{row['mean_steps']:.1f}",
            rounded(row["replayed_to_goal"]),
            f"{row['bytes_per_flight'] / 1e3:.1f}",
        ]
        for name, section in results["sections"].items()
        for row in section["rows"]
    ]
    processes = max(row["processes"] for section in results["sections"].values() for row in section["rows"])
    dates = " and ".join(sorted({section["date"][:10] for section in results["sections"].values()}))
    note = (
        f"`python -m experiments.measurements.demonstrations` with {processes} processes, {dates}: from the order to the dataset on "
        "disk. Flights are proven only where that is asked for, by a time budget."
    )
    return markdown(head, rows) + "\n\n" + fill(note, WIDTH, break_on_hyphens=False)
