"""The README's tables, written from published results files.

    paper       paper.json        what became of the paper's times
    optima      solvers.json      what is known of each named scenario
    roads       solvers.json      how right, robust and fast the solvers are

That of the environments is in `experiments.publishing.environments`.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import floor
from textwrap import fill
from typing import Any

from experiments.publishing.markdown import markdown

OPTIMA = ("bounds", "steps", "goal_bounds", "goal_steps", "validity")
"""Sections that the table of the optima is made of."""


def optima(results: dict[str, Any]) -> str:
    """Return what is known of each named scenario's optimum: flown, proven, in time and in steps; then the batches."""
    rows = {name: section["rows"] for name, section in results["sections"].items()}
    known, every = {row["scenario"]: row for row in rows["steps"]}, rows["goal_steps"][-1]
    table = []
    for row in rows["bounds"]:
        k = known[row["scenario"]]
        fewest = f"{k['k_star']}" if k["proven"] else f"{k['k_star']}, at least {k['lower_bound']}"
        bound = f"{floor(row['lower_bound_s'] * 1e5) / 1e5:.5f}"  # rounded upwards it would be none
        proof = "-" if row["to_0.1%_s"] is None else f"{row['to_0.1%_s']:.2f}"
        cells = [row["scenario"], f"{row['flown_s']:.5f}", bound, f"{row['gap']:.3%}", proof, fewest]
        table.append([*cells, "yes" if k["proven"] else "no"])
    goals, held = rows["goal_bounds"][-1], rows["validity"]
    words = (
        f"On {goals['goals']} random goals, asked for 0.1%, the gap is {goals['gap_median']:.3%} at the median and "
        f"{goals['gap_worst']:.3%} at worst, in {goals['wall_time_median_s']:.2f} s; of {every['goals']} others' K* "
        f"{every['proven']} are proven, and the rest open by {every['gap_steps_worst']} step at most. Of the bounds of "
        f"{sum(row['goals'] for row in held)} random tasks of three vehicles, "
        f"{sum(row['above_a_flight'] for row in held)} lie above the time of a certified flight."
    )
    head = ["scenario", "T* flown [s]", "no flight is faster than [s]", "gap", "0.1% takes [s]", "K*", "K* proven"]
    return markdown(head, table) + "\n\n" + fill(words, 118) + "\n\n" + told(results, OPTIMA)


def told(results: dict[str, Any], sections: Iterable[str]) -> str:
    """Return how sections of the solvers' benchmark came about."""
    dates = sorted({results["sections"][name]["date"][:10] for name in sections})
    return (
        f"`python -m experiments.measurements.solvers` on {results['machine']['cores']} cores, {' and '.join(dates)}."
    )


ROADS = (
    "references", "starts", "speed", "flat", "corridors", "pontryagin", "systems", "orders", "flat_orders", "batch",
    "warm",
)  # fmt: skip
"""Sections that the table of the roads is made of."""


def roads(results: dict[str, Any]) -> str:
    """Return what the solvers' benchmark found, one line a question."""
    rows = {name: section["rows"] for name, section in results["sections"].items()}
    solved = [row for row in rows["references"] if row["status"].startswith("Solved")]
    off = max(abs(row["deviation"]) for row in rows["references"] if row["deviation"] is not None)
    total = rows["starts"][-1]
    clock = {row["what"]: row["median_s"] for row in rows["speed"]}
    warm = {row["what"]: row["median_s"] for row in rows["warm"]}
    flat = {row["scenario"]: row for row in rows["flat"]}
    level = [row for name, row in flat.items() if name.startswith(("horizontal", "ground"))]
    automatic = {row["scenario"]: row for row in rows["corridors"]}
    slopes = {name: [row["order"] for row in rows[name]] for name in ("orders", "flat_orders")}
    bends = [automatic[name] for name in ("hoop", "high-hoop", "slalom")]

    def span(values: list[float]) -> str:
        return f"{min(values):.1f} to {max(values):.1f}"

    table = [
        ["named scenarios solved and certified by shooting", f"{len(solved)} of {len(rows['references'])}"],
        ["their largest distance from T* known from elsewhere", f"{off:.3%}"],
        ["random starts to random goals that converge", f"{total['converged']} of {total['starts']}"],
        ["those that find the best time of the winding", f"{total['found_best']} of {total['starts']}"],
        [
            "Pontryagin against shooting, largest distance",
            f"{max(abs(r['difference']) for r in rows['pontryagin']):.1e}",
        ],
        ["flat over T*, horizontals and ground-6, largest", f"{max(r['above_best'] for r in level):.2%}"],
        *[[f"flat over T* of its corridor, {n}", f"{flat[n]['above_best']:.2%}"] for n in ("diagonal", "hoop")],
        ["flat, warm: horizontals and ground-6 [s]", f"{max(r['warm_s'] for r in level):.2f}"],
        ["flat, warm: diagonal, hoop [s]", ", ".join(f"{flat[n]['warm_s']:.1f}" for n in ("diagonal", "hoop"))],
        [
            "flat from the paper's own start on other grids: certified, and within 0.5 %",
            f"{sum(r['starts_certified'] for r in flat.values())}, {sum(r['starts_good'] for r in flat.values())} of "
            f"{sum(r['starts'] for r in flat.values())}",
        ],
        [
            "automatic corridors over T*: hoop, high-hoop, slalom",
            ", ".join(f"{row['above_best']:.1%}" + ("" if row["optimised"] else " (not optimised)") for row in bends),
        ],
        [
            "other systems' inputs through SciPy's DOP853, largest error",
            f"{max(r['replay_error'] for r in rows['systems']):.0e}",
        ],
        ["order of convergence: shooting, flat", f"{span(slopes['orders'])}, {span(slopes['flat_orders'])}"],
        [
            "warm shooting solve, 100 steps [ms]; rockit's [ms]",
            f"{clock['shooting'] * 1e3:.0f}; {clock['rockit'] * 1e3:.0f}",
        ],
        ['`solve("hoop")`, all windings, certified, warm [s]', f"{warm['solve hoop']:.2f}"],
        *[
            [f"`{row['what']}` of random goals, two processes [1/s]", f"{row['per_second']:.0f}"]
            for row in rows["batch"]
        ],
        ["`import optimal` [s]", f"{clock['import optimal']:.2f}"],
    ]
    return markdown(["question", "answer"], table) + "\n\n" + told(results, ROADS)
