"""Measurements of the chain bound on tracks: convergence, work against the number of hoops, sampled tracks, validity.

Each function with a parameter `advance` is a section of `experiments.measurements.solvers`.
"""

from __future__ import annotations

import math
import statistics
import time
from dataclasses import replace

import numpy as np

import optimal
from experiments.files import Row
from experiments.measurements.proofs import LIMITS, LONG_BUDGET, proof_row
from experiments.measurements.reference_table import SAMPLED
from experiments.measurements.sections import Advance, in_parallel
from flatgym import DISTRIBUTIONS, Scenario
from flatgym.scenarios.reference import EVALUATION_SEED, drawn_k_star
from flatgym.scenarios.tracks import weave
from optimal import prove
from optimal.direct.multistart import search
from optimal.direct.shooting import ShootingSolution
from optimal.proof.lower_bound import Proof, Verdict, prove_near, raise_bound

CONVERGING = ("hoop", "slalom", "loop")
GAPS = (0.1, 0.03, 0.01, 3e-3, 1e-3, 5e-4, 2e-4)
"""Scenarios of `convergence`, and the gaps that are requested one after the other."""
COUNTS, COUNT_GAP, COUNT_BUDGET = (1, 2, 4, 8, 12, 16), 0.01, 300.0
"""Numbers of hoops, requested gap, and time budget of each proof [s] of `hoops`."""
DRAWS, DRAW_GAP, DRAW_BUDGET = 100, 2e-3, 60.0
"""Draws of `random-track`, requested gap, and time budget of each proof [s]."""
WIDE_GAP, WIDE_BUDGET = 1e-2, 600.0
"""Gap above which a draw is proven again, with this gap requested, and the time budget of that proof [s]."""
VEHICLES = ("the paper's", "strong and slow to turn")
"""Vehicles of `track_validity`, names in `proofs.LIMITS`."""
VALIDATED, VALID_HOOPS, VALID_GAP, VALID_BUDGET = 200, (2, 6), 5e-3, 5.0
"""Tracks of each vehicle, least and greatest number of hoops, requested gap, and time budget of each search [s]."""
SLOWER, SLOWER_BUDGET = 1.01, 2.0
"""Duration that must not be excluded, relative to the flown time, and wall time of the attempt [s]."""


def convergence(quick: bool, advance: Advance) -> list[Row]:
    """How long does a proof take for decreasing gaps? A scenario ends with the first proof that spends its budget."""
    names, gaps = (CONVERGING[:1], GAPS[:3]) if quick else (CONVERGING, GAPS)
    prove("hoop", max_gap=GAPS[0])  # compiles the kernels, or loads them
    rows = []
    for i, name in enumerate(names):
        for j, gap in enumerate(gaps):
            proof = prove(name, max_gap=gap, time_budget=LONG_BUDGET)
            rows.append(proof_row(proof) | {"gap_asked": gap})
            advance(i * len(gaps) + j + 1, len(names) * len(gaps))
            if proof.verdict is not Verdict.CLOSED:
                break
    return rows


def hoops(quick: bool, advance: Advance) -> list[Row]:
    """How does the work for a gap of 1 % grow with the number of hoops of the slalom?

    The processor time of a proof is the sum over its threads. It depends little on other work of the machine.
    """
    prove("hoop", max_gap=COUNT_GAP)  # compiles the kernels, or loads them
    counts = COUNTS[:2] if quick else COUNTS
    rows = []
    for i, count in enumerate(counts):
        track = slalom(count)
        flown = optimal.solve(track, max_gap=None, raise_on_failure=False)
        begun = time.process_time()
        proof = prove(track, max_gap=COUNT_GAP, time_budget=COUNT_BUDGET)
        asked = {"gap_asked": COUNT_GAP, "processor_time_s": time.process_time() - begun}
        rows.append(proof_row(proof) | {"hoops": count, "certified_s": flown.time} | asked)
        advance(i + 1, len(counts))
    return rows


def slalom(count: int) -> Scenario:
    """Return the slalom with a number of hoops, alternately 1.5 m above and below the start, 2.5 m apart along x."""
    return weave(f"slalom of {count}", count, 2.5, 1.5, 1.5, time_limit=20.0)


def random_tracks(quick: bool, advance: Advance) -> list[Row]:
    """How small is the gap of sampled tracks after a minute each, and with longer ones where it is wide?

    A row a track, then a total.
    """
    count, budget = (1, 0.3) if quick else (DRAWS, DRAW_BUDGET)
    tracks = [DISTRIBUTIONS["random-track"].scenario(EVALUATION_SEED + i) for i in range(count)]
    rows = in_parallel(random_track, [(track, budget) for track in tracks], advance)
    gaps = [row["gap"] for row in rows]
    total = {
        "tracks": len(rows),
        "certified": sum(math.isfinite(row["certified_s"]) for row in rows),
        "checked": sum(row["checked"] for row in rows),
        "gap_median": statistics.median(gaps),
        "gap_worst": max(gaps),
        "wall_time_median_s": statistics.median(row["wall_time_s"] for row in rows),
        "wide": sum(row["gap_of_first_proof"] > WIDE_GAP for row in rows),
    }
    asked = {"gap_asked": DRAW_GAP, "budget_s": budget, "wide_gap": WIDE_GAP, "wide_budget_s": wide_budget(budget)}
    return [*rows, {"scenario": "all", **asked, **total}]


def wide_budget(budget: float) -> float:
    """Return the time budget of the second proof of a track, by that of the first [s]."""
    return budget * WIDE_BUDGET / DRAW_BUDGET


def random_track(track: Scenario, budget: float) -> Row:
    """Return the row of one sampled track."""
    flown = optimal.solve(track, max_gap=None, raise_on_failure=False)
    proof = prove(track, max_gap=DRAW_GAP, time_budget=budget)
    row = proof_row(proof) | {"gap_of_first_proof": proof.gap}
    if proof.gap > WIDE_GAP:
        again = proof_row(prove(track, max_gap=WIDE_GAP, time_budget=wide_budget(budget)))
        row |= min(row, again, key=lambda one: one["gap"]) | {"wall_time_s": row["wall_time_s"] + again["wall_time_s"]}
    return row | {"hoops": len(track.hoops), "certified_s": flown.time}


def track_validity(quick: bool, advance: Advance) -> list[Row]:
    """Is a bound ever above a certified flight, or a time excluded that a flight needs? One row a vehicle."""
    count, budget = (1, 1.0) if quick else (VALIDATED, VALID_BUDGET)
    tasks = []
    for name in VEHICLES:
        kind = replace(DISTRIBUTIONS["random-track"], name="track", hoops=VALID_HOOPS, quadrotor=LIMITS[name])
        tasks += [(name, kind.scenario(i), budget) for i in range(count)]
    compared = in_parallel(bound_and_track, tasks, advance)
    rows = []
    for name in VEHICLES:
        of_vehicle = [row for row in compared if row["limits"] == name]
        flown = [row for row in of_vehicle if math.isfinite(row["upper_bound_s"])]
        gaps = [row["gap"] for row in flown]
        rows.append(
            {
                "limits": name,
                "tracks": len(of_vehicle),
                "certified": len(flown),
                "above_a_flight": sum(row["lower_bound_s"] > row["upper_bound_s"] for row in flown),
                "slower_excluded": sum(row["slower_excluded"] for row in flown),
                "evaluations": sum(row["evaluations"] for row in flown),
                "checked": sum(row["checked"] for row in flown),
                "least_gap": min(gaps, default=math.nan),
                "gap_median": statistics.median(gaps) if gaps else math.nan,
            }
        )
    return rows


def bound_and_track(limits: str, track: Scenario, budget: float) -> Row:
    """Return the lower bound of a track, its certified flight, and whether a longer duration is excluded."""
    flown = optimal.solve(track, max_gap=None, raise_on_failure=False).time
    shots = search(track).shots
    if shots:
        proof = prove_near(track, shots[0], max_gap=VALID_GAP, time_budget=budget)
    else:
        proof = prove(track, max_gap=VALID_GAP, time_budget=budget)
    slower = slower_proof(track, shots[0], min(budget, SLOWER_BUDGET)) if shots else None
    return {
        "limits": limits,
        "lower_bound_s": proof.time,
        "upper_bound_s": flown,
        "gap": flown / proof.time - 1,
        "checked": proof.check(),
        "slower_excluded": slower is not None and slower.time >= SLOWER * slower.flown,
        "evaluations": slower.evaluations if slower else 0,
    }


def slower_proof(track: Scenario, shot: ShootingSolution, budget: float) -> Proof:
    """Return what is proven by an attempt to exclude 1.01 times the flown time, which must fail.

    The vehicle can hover before the fastest flight, so a flight of that duration exists.
    """
    longer = SLOWER * shot.trajectory.duration
    return raise_bound(track, shot, None, [(longer, abs(SLOWER - 1))], budget)


def sampled_steps(quick: bool, advance: Advance) -> list[Row]:
    """For how many of the sampled scenarios that scores use is K* proven, and which are open? One row a distribution.

    The numbers are those of the table that ships with flatgym.
    """
    rows = []
    for i, (name, count) in enumerate(SAMPLED.items()):
        seeds = EVALUATION_SEED + np.arange(min(count, 100) if quick else count)
        drawn = drawn_k_star(name, seeds)
        known = np.isfinite(drawn.k_star)
        unproven = known & ~drawn.proven
        rows.append(
            {
                "distribution": name,
                "draws": int(known.sum()),
                "proven": int(drawn.proven.sum()),
                "open_seeds": seeds[unproven].tolist(),
                "gap_steps_worst": int((drawn.k_star - drawn.k_lower_bound)[known].max(initial=0)),
            }
        )
        advance(i + 1, len(SAMPLED))
    return rows
