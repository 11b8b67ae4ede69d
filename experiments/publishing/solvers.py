"""The solvers' tables, from `solvers.json`: best-known solutions with their bounds, and answers on the methods.

The environments' table is in `experiments.publishing.environments`, the paper's in `experiments.publishing.tables`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from experiments.corridor_figure import FILE, SECTION
from experiments.files import Row
from experiments.formats import lower_bound, percent
from experiments.provenance import provenance_sentence
from experiments.publishing.markdown import markdown, paragraph

OPTIMA = ("bounds", "steps", "goal_bounds", "goal_steps", "validity")
"""Sections of the table of optima."""
METHODS = (
    "references", "starts", "speed", "flat", "corridors", "pontryagin", "systems", "orders", "flat_orders", "batch",
    "warm", "flat_flights", "flat_draws",
)  # fmt: skip
"""Sections of the table of methods."""


def optima(results: dict[str, Any]) -> str:
    """Return the best-known T* and K* of each named scenario with their bounds, and statistics of uniform goals."""
    rows = {name: section["rows"] for name, section in results["sections"].items()}
    steps, total = {row["scenario"]: row for row in rows["steps"]}, rows["goal_steps"][-1]
    head = ["scenario", "T* upper bound [s]", "lower bound [s]", "gap", "time to 0.1 % gap [s]", "K*", "K* proven"]
    goals, validity = rows["goal_bounds"][-1], rows["validity"]
    text = (
        f"On {goals['goals']} uniform goals (in the square of half-width 10 m around the start), with a requested gap "
        f"of 0.1 %, the median gap is {percent(goals['gap_median'], 3)}, the largest {percent(goals['gap_worst'], 3)}, "
        f"at a median of {goals['wall_time_median_s']:.2f} s. K* is proven for {total['proven']} of {total['goals']} "
        f"other uniform goals; for the rest at most {total['gap_steps_worst']} step is open. Of the lower bounds of "
        f"{sum(row['goals'] for row in validity)} uniform goals with three vehicles, "
        f"{sum(row['above_a_flight'] for row in validity)} are above the time of a certified flight."
    )
    table = [optimum(row, steps[row["scenario"]]) for row in rows["bounds"]]
    return "\n\n".join([markdown(head, table), paragraph(text), measured_by(results, OPTIMA)])


def optimum(bound: Row, steps: Row) -> list[str]:
    """Return the cells of a named scenario."""
    time = bound["to_0.1%_s"]
    return [
        f"`{bound['scenario']}`",
        f"{bound['upper_bound_s']:.5f}",
        lower_bound(bound["lower_bound_s"]),
        percent(bound["gap"], 3),
        "-" if time is None else f"{time:.2f}",
        f"{steps['k_star']}" if steps["proven"] else f"{steps['k_star']} (≥\N{NO-BREAK SPACE}{steps['lower_bound']})",
        "yes" if steps["proven"] else "no",
    ]


def measured_by(results: dict[str, Any], sections: Iterable[str]) -> str:
    """Return command, machines and dates of sections as a paragraph, one sentence for each machine."""
    dates: dict[str, list[str]] = {}
    for name in sections:
        if name not in results["sections"]:
            continue
        section = results["sections"][name]
        holder = section if "machine" in section else results
        source = {key: holder[key] for key in ("machine", "processor") if key in holder}
        dates.setdefault(json.dumps(source), []).append(section["date"])
    command = "flatquad measure solvers"
    return paragraph(
        " ".join(
            provenance_sentence({"smoke": results.get("smoke")} | json.loads(source), command=command, dates=days)
            for source, days in dates.items()
        )
    )


def methods(results: dict[str, Any]) -> str:
    """Return correctness, robustness and speed of the methods, one line a question."""
    rows = {name: section["rows"] for name, section in results["sections"].items()}
    lines = [*shooting_lines(rows), *flat_lines(rows), *system_lines(rows), *speed_lines(rows)]
    return markdown(["question", "answer"], lines) + "\n\n" + measured_by(results, METHODS)


def shooting_lines(rows: dict[str, list[Row]]) -> list[list[str]]:
    """Return how right and how robust shooting is, and its agreement with the indirect method."""
    solved = [row for row in rows["references"] if row["status"].startswith("Solved")]
    deviation = max(abs(row["deviation"]) for row in rows["references"] if row["deviation"] is not None)
    total, difference = rows["starts"][-1], max(abs(row["difference"]) for row in rows["pontryagin"])
    return [
        ["named scenarios solved and certified by shooting", f"{len(solved)} of {len(rows['references'])}"],
        ["their largest deviation from T* of other code", percent(deviation, 3)],
        ["random initial guesses for uniform goals that converge", f"{total['converged']} of {total['starts']}"],
        ["those that find the best time of the winding", f"{total['found_best']} of {total['starts']}"],
        ["indirect method against shooting, largest relative difference", f"{difference:.1e}"],
    ]


def flat_lines(rows: dict[str, list[Row]]) -> list[list[str]]:
    """Return how close to T* the flat method comes, and how robust and fast it is."""
    flat = {row["scenario"]: row for row in rows["flat"]}
    level = [row for name, row in flat.items() if name.startswith(("horizontal", "ground"))]
    automatic = {row["scenario"]: row for row in rows["corridors"]}
    bends = [automatic[name] for name in ("hoop", "high-hoop", "slalom")]
    certified, good, starts = (
        sum(row[key] for row in flat.values()) for key in ("starts_certified", "starts_good", "starts")
    )
    return [
        [
            "the paper's outer paths and start: above T*, horizontals and ground-6, largest",
            percent(max(r["above_best"] for r in level), 2),
        ],
        *[
            [f"the same: above T* of its corridor, {name}", percent(flat[name]["above_best"], 2)]
            for name in ("diagonal", "hoop")
        ],
        ["the same, warm: horizontals and ground-6 [s]", f"{max(row['warm_s'] for row in level):.2f}"],
        ["the same, warm: diagonal, hoop [s]", ", ".join(f"{flat[n]['warm_s']:.1f}" for n in ("diagonal", "hoop"))],
        [
            "the same, several grids: certified, and within 0.5 %",
            f"{certified}, {good} of {starts}",
        ],
        [
            "automatic outer paths and the paper's start: above T*, hoop, high-hoop, slalom",
            ", ".join(percent(row["above_best"]) + ("" if row["optimised"] else " (not optimised)") for row in bends),
        ],
        *corridor_lines(rows),
    ]


def corridor_lines(rows: dict[str, list[Row]]) -> list[list[str]]:
    """Return how close to T* the flat method comes in corridors around flights, as far as it is measured."""
    lines = []
    if named := rows.get("flat_flights"):
        worst = max(named, key=lambda row: row["above_best"])
        lines.append(
            [
                "flat method, corridors around flights: named scenarios certified, largest above T*",
                f"{sum(row['certified'] for row in named)} of {len(named)}, {percent(worst['above_best'], 2)} "
                f"(`{worst['scenario']}`)",
            ]
        )
        if all("processor_time_s" in row for row in named):  # wall times depend on what else runs
            longest = max(named, key=lambda row: row["processor_time_s"])
            lines.append(
                [
                    "the same, warm, without the start: longest processor time [s]",
                    f"{longest['processor_time_s']:.1f} (`{longest['scenario']}`)",
                ]
            )
    return lines + [
        [
            f"the same, {row['kind']}: certified, median and largest above T*",
            f"{row['certified']} of {row['scenarios']}, {percent(row['above_best_median'], 2)}, "
            f"{percent(row['above_best_largest'], 2)}",
        ]
        for row in rows.get("flat_draws", ())
    ]


def corridors(results: dict[str, Any]) -> str:
    """Return the figure as Markdown, with what it shows and where it was measured."""
    if SECTION not in results["sections"]:
        return f"Not measured yet. `flatquad measure solvers {SECTION}` and `flatquad publish` fill this place."
    rows = results["sections"][SECTION]["rows"]
    parts = [
        f"`{row['scenario']}` from {row['times_s'][0]:.3f} s to {row['times_s'][-1]:.4f} s, "
        f"{percent(row['times_s'][-1] / row['best_s'] - 1, 2)} above T*"
        for row in rows
    ]
    text = (
        f"They start from flights of a vehicle with {rows[0]['thrust_max_of_start']:g} m/s² of thrust instead of 20 "
        f"m/s²: {'; '.join(parts)}. All flights are certified."
    )
    picture = f"![Corridors that follow the flight](experiments/results/published/{FILE})"
    return "\n\n".join([picture, paragraph(text), measured_by(results, (SECTION,))])


def system_lines(rows: dict[str, list[Row]]) -> list[list[str]]:
    """Return the accuracy for other flat systems, and the orders of convergence."""
    slopes = {name: [row["order"] for row in rows[name]] for name in ("orders", "flat_orders")}
    shooting, flat = (f"{min(values):.1f} to {max(values):.1f}" for values in slopes.values())
    error = max(row["replay_error"] for row in rows["systems"])
    return [
        ["other flat systems: inputs integrated by SciPy's DOP853, largest error", f"{error:.0e}"],
        ["order of convergence: shooting, flat method", f"{shooting}, {flat}"],
    ]


def speed_lines(rows: dict[str, list[Row]]) -> list[list[str]]:
    """Return solve times, batch rates and the import time."""
    times = {row["what"]: row["median_s"] for row in rows["speed"]}
    warm = {row["what"]: row["median_s"] for row in rows["warm"]}
    return [
        [
            "warm shooting solve, 100 steps [ms]; by rockit [ms]",
            f"{times['shooting'] * 1e3:.0f}; {times['rockit'] * 1e3:.0f}",
        ],
        ['`solve("hoop")`, all windings, certified, warm [s]', f"{warm['solve hoop']:.2f}"],
        *[
            [f"`{row['what']}` of uniform goals, two processes [1/s]", f"{row['per_second']:.0f}"]
            for row in rows["batch"]
        ],
        ["`import optimal` [s]", f"{times['import optimal']:.2f}"],
    ]
