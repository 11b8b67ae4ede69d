"""The paper's results beside ours: what it printed, what its transcription gives, what can be flown.

`compare` answers for one case, Table I, the ground constraint, the displacement to (5, 5) or the hoop,
at which time each road arrives. The printed numbers are facts of the paper; all others are computed here.

`judge` asks which printed times are impossible: below a proven lower bound of the flight time, under the
paper's own limits, even if the last printed digit was rounded down.

`ease` looks into the paper's argument that its problem "can be initialized easily" (section II-E): for
each road, with a plain start and no search, how many iterations and seconds it takes, and how often it
arrives. Seconds are told cold, with the program yet to be built, and warm; so every question of `tables`
is answered in a process of its own.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import floor, inf
from typing import Any

import pandas as pd

import optimal
from flatgym import SCENARIOS, Scenario
from optimal.corridors import paper_corridor
from optimal.costates import arcs_of
from optimal.planning import plan
from optimal.pontryagin import fastest, refine
from optimal.refinement import INTERVALS
from optimal.shooting import NODES, shoot
from optimal.trajectory import Flight

PRINTED: dict[str, str | None] = {
    "horizontal-3": "0.8902",
    "horizontal-6": "1.223",
    "horizontal-9": "1.478",
    "horizontal-12": "1.694",
    "horizontal-15": "1.885",
    "ground-6": "1.227",
    "diagonal": "1.289",
    "hoop": None,
}
"""Flight times the paper prints [s], with the digits it prints; None where it shows a flight without its time."""

PONTRYAGIN: dict[str, str] = {
    "horizontal-3": "0.8977",
    "horizontal-6": "1.231",
    "horizontal-9": "1.488",
    "horizontal-12": "1.705",
    "horizontal-15": "1.895",
    "diagonal": "1.4",
}
"""Flight times of the paper's reference [8] as the paper prints them [s], with these digits."""

COLUMNS = (
    "scenario",
    "printed_s",
    "nodes_only_s",
    "nodes_only_violation",
    "flat_certified_s",
    "flat_status",
    "shooting_s",
    "pontryagin_s",
    "reference_8_s",
    "lower_bound_s",
)
JUDGED_COLUMNS = (
    "scenario",
    "printed_s",
    "lower_bound_s",
    "flown_s",
    "gap",
    "shortfall_s",
    "shortfall",
    "impossible",
    "reference_8_s",
    "reference_8_impossible",
)
EASE_COLUMNS = ("scenario", "road", "best_s", "iterations", "cold_s", "warm_s", "starts", "converged", "succeeded")

INTERVAL_COUNTS = (20, 30, 40, 50, 60)
"""Grids of the flat roads' plain starts."""
NODE_COUNTS = (50, 75, 100, 150, 200)
"""Grids of the plain starts of shooting, and of the direct solutions that Pontryagin's conditions begin from."""
SUCCESS = 5e-3
"""How much slower than the road's fastest a certified flight may be, relatively, to count as found."""
MAX_GAP, TIME_BUDGET = 2e-4, 30.0
"""How close to the fastest flight the lower bounds are to come, relatively, and the time granted for each [s]."""
PROCESSES = 2


def compare(name: str) -> dict[str, Any]:
    """Return the row of one case, keyed by COLUMNS; a road that finds no certified flight leaves inf.

    None stands where there is nothing to be said: not printed, or not within a road's reach.
    """
    # A bound holds for every road, so that it is proven once.
    nodes = optimal.solve(name, method="flat", checks="nodes", max_gap=None, throw=False)
    flat = optimal.solve(name, method="flat", max_gap=None, throw=False)
    shooting = optimal.solve(name, max_gap=MAX_GAP, time_budget=TIME_BUDGET, throw=False)
    return {
        "scenario": name,
        "printed_s": seconds(PRINTED[name]),
        "nodes_only_s": nodes.time,
        "nodes_only_violation": nodes.certificate.max_control_violation,
        "flat_certified_s": flat.time,
        "flat_status": flat.status.value,
        "shooting_s": shooting.time,
        "pontryagin_s": fastest(SCENARIOS[name]).time if in_free_space(name) else None,
        "reference_8_s": seconds(PONTRYAGIN.get(name)),
        "lower_bound_s": shooting.certificate.lower_bound,
    }


def judge(name: str) -> dict[str, Any]:
    """Return whether the printed time of one case is possible at all, keyed by JUDGED_COLUMNS.

    No flight is faster than `lower_bound_s`, and one takes `flown_s`, the `gap` above it. `shortfall_s` [s] and
    `shortfall` (relative) say how far below the bound the printed time lies; None where it does not. A time that
    is not `impossible` is not excluded, which does not make it possible; None where none is printed.
    """
    proof = optimal.prove(name, max_gap=MAX_GAP, time_budget=TIME_BUDGET)
    bound, printed, reference = proof.time, PRINTED[name], PONTRYAGIN.get(name)
    time_s = seconds(printed)
    shortfall = None if time_s is None or time_s >= bound else bound - time_s
    return {
        "scenario": name,
        "printed_s": time_s,
        "lower_bound_s": bound,
        "flown_s": proof.flown,
        "gap": proof.gap,
        "shortfall_s": shortfall,
        "shortfall": None if shortfall is None else shortfall / bound,
        "impossible": impossible(printed, bound),
        "reference_8_s": seconds(reference),
        "reference_8_impossible": impossible(reference, bound),
    }


def seconds(printed: str | None) -> float | None:
    """Return a printed time as a number [s]."""
    return None if printed is None else float(printed)


def rounded_up(printed: str) -> float:
    """Return the longest time that is printed so [s]: half a unit of the last digit more."""
    return float(printed) + 0.5 * 10.0 ** -len(printed.partition(".")[2])


def impossible(printed: str | None, bound: float) -> bool | None:
    """Return whether every time that is printed so lies below a lower bound [s]; None where none is printed."""
    return None if printed is None else rounded_up(printed) < bound


def in_free_space(name: str) -> bool:
    """Return whether a case has neither hoops nor floor nor ceiling, as Pontryagin's conditions need it."""
    scenario = SCENARIOS[name]
    return not scenario.hoops and scenario.floor is None and scenario.ceiling is None


@dataclass(frozen=True)
class Run:
    """One solve from one plain start: whether the solver `converged`, its `iterations`, the `flight` or None."""

    converged: bool
    iterations: int
    flight: Flight | None


def flat(scenario: Scenario, intervals: int, checks: str) -> Run:
    """Solve eq. (10) from the slow start on the central path, section II-E."""
    outer = paper_corridor(scenario)
    found = plan(outer.paths, scenario.quadrotor, ends=outer.ends, checks=checks, intervals=intervals)
    return Run(found.converged, found.iterations, found.trajectory)


def shooting(scenario: Scenario, nodes: int) -> Run:
    """Solve the shooting problem without a turn, from the straight line."""
    found = shoot(scenario, nodes=nodes)
    return Run(found.converged, found.iterations, found.trajectory if found.converged else None)


def pontryagin(scenario: Scenario, nodes: int) -> Run:
    """Solve Pontryagin's conditions with the arcs of the direct solution of `shooting`.

    Its iterations are the evaluations of the conditions, after the direct solution's.
    """
    direct = shoot(scenario, nodes=nodes)
    if not direct.converged:
        return Run(False, direct.iterations, None)
    found = refine(scenario, 0, *arcs_of(direct))
    return Run(found.converged, direct.iterations + found.evaluations, found.trajectory)


ROADS: dict[str, tuple[Callable[[Scenario, int], Run], int, tuple[int, ...]]] = {
    "flat, nodes only": (partial(flat, checks="nodes"), INTERVALS, INTERVAL_COUNTS),
    "flat, certified": (partial(flat, checks="certified"), INTERVALS, INTERVAL_COUNTS),
    "shooting": (shooting, NODES, NODE_COUNTS),
    "pontryagin": (pontryagin, NODES, NODE_COUNTS),
}
"""The roads by name: one solve from a plain start, the grid on which it is timed, the grids of the starts."""


def ease(name: str, road: str) -> dict[str, Any]:
    """Return how easily a road is travelled in one case, keyed by EASE_COLUMNS.

    A start has `succeeded` if its flight is certified in continuous time, and within SUCCESS of the
    road's fastest; what holds at nodes only never does.

    Args:
        name: a case of PRINTED.
        road: a key of ROADS.
    """
    scenario, (solve, size, sizes) = SCENARIOS[name], ROADS[road]
    cold, _ = timed(lambda: solve(scenario, size))
    warm, run = timed(lambda: solve(scenario, size))
    runs = [solve(scenario, grid) for grid in sizes]
    times = [certified_time(scenario, each) for each in [run, *runs]]
    best = min(times)
    return {
        "scenario": name,
        "road": road,
        "best_s": best,
        "iterations": run.iterations,
        "cold_s": cold,
        "warm_s": warm,
        "starts": len(sizes),
        "converged": sum(each.converged for each in runs),
        "succeeded": sum(duration < inf and duration <= best * (1 + SUCCESS) for duration in times[1:]),
    }


def certified_time(scenario: Scenario, run: Run) -> float:
    """Return the flight time [s], or inf where the certificate does not hold."""
    if run.flight is None or not optimal.certify(run.flight, scenario).holds():
        return inf
    return run.flight.duration


def timed(solve: Callable[[], Run]) -> tuple[float, Run]:
    """Return the wall time of a solve [s] and its result."""
    begun = time.perf_counter()
    run = solve()
    return time.perf_counter() - begun, run


TABLES: dict[str, tuple[Callable[..., dict[str, Any]], tuple[str, ...]]] = {
    "rows": (compare, COLUMNS),
    "judged": (judge, JUDGED_COLUMNS),
    "ease": (ease, EASE_COLUMNS),
}
"""The tables by their names in results files: what answers for one row, and the columns."""


def questions() -> list[tuple[str, tuple[str, ...]]]:
    """Return the table of every row, and the case, or case and road, that it answers for."""
    cases = [(table, (name,)) for table in ("rows", "judged") for name in PRINTED]
    roads = [(name, road) for name in PRINTED for road in ROADS if road != "pontryagin" or in_free_space(name)]
    return [*cases, *(("ease", pair) for pair in roads)]


def answer(question: tuple[str, tuple[str, ...]]) -> dict[str, Any]:
    """Return the row that answers one of the `questions`."""
    table, about = question
    return TABLES[table][0](*about)


def tables(progress: Callable[[], Any] = lambda: None) -> dict[str, pd.DataFrame]:
    """Return the TABLES by name; `progress` is called after each of the `questions`.

    Each is answered in a new process, so that cold is cold.
    """
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in TABLES}
    asked = questions()
    with multiprocessing.get_context("spawn").Pool(PROCESSES, maxtasksperchild=1) as pool:
        for (table, _), row in zip(asked, pool.imap(answer, asked), strict=True):
            rows[table].append(row)
            progress()
    return {name: pd.DataFrame(rows[name], columns=list(columns)) for name, (_, columns) in TABLES.items()}


def verdicts(judged: pd.DataFrame) -> pd.DataFrame:
    """Return the judged table as one reads it, in words; bounds are rounded down, so that they stay bounds."""

    def verdict(row: dict[str, Any]) -> str:
        if not row["impossible"]:
            return "-" if row["impossible"] is None else "not excluded"
        return f"{row['shortfall_s']:.4f} s, {row['shortfall']:.2%}"

    return pd.DataFrame(
        {
            "case": row["scenario"],
            "printed": PRINTED[row["scenario"]] or "-",
            "bound": f"{floor(row['lower_bound_s'] * 1e5) / 1e5:.5f}",
            "flown": f"{row['flown_s']:.5f}",
            "gap": f"{row['gap']:.3%}",
            "impossible by": verdict(row),
        }
        for row in judged.to_dict("records")
    )


def judgement(judged: pd.DataFrame) -> str:
    """Return in a sentence how many printed times are impossible, and which of reference [8]'s."""
    printed, reference = (judged.set_index("scenario")[of].dropna() for of in ("impossible", "reference_8_impossible"))
    names = [name for name, excluded in reference.items() if excluded]
    which = f" ({', '.join(names)})" if names else ""
    return (
        f"So {sum(printed)} of the paper's {len(printed)} times are impossible, and {len(names)} of the "
        f"{len(reference)} of its reference [8]{which}."
    )


def by_road(ease: pd.DataFrame) -> pd.DataFrame:
    """Return the ease table with one row a road: cases, medians over them, and sums of starts."""
    grouped = ease.groupby("road", sort=False)
    medians, sums = ["iterations", "cold_s", "warm_s"], ["starts", "converged", "succeeded"]
    return pd.concat(
        [grouped.size().rename("cases"), grouped[medians].median(), grouped[sums].sum()], axis=1
    ).reset_index()
