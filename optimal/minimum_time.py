"""The minimum flight time T* of a scenario: one of three methods, then a certificate and a proven lower bound.

method       a Candidate: the fastest flight that shooting, the flat method or Pontryagin's conditions give
certify      its limits, replay and hoops, checked independently of the method
prove        a time that no flight can beat
Solution     the answer, packed once
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from flatgym.scenarios.catalogue import ScenarioLike, scenario
from flatgym.scenarios.scenario import Scenario
from flatgym.validation import choice
from optimal.candidates import Candidate, by_flat_method, by_pontryagin, by_shooting, in_fixed_corridor
from optimal.direct.clearance import tighten
from optimal.direct.multistart import STARTS
from optimal.direct.program import NODES
from optimal.direct.shooting import WINDINGS, ShootingSolution
from optimal.direct.solver_process import SolverLost, lost_calls
from optimal.direct.transcription import distinct_hoops
from optimal.flights.certificate import Certificate, certify
from optimal.flights.solution import Solution, SolveFailed, Status
from optimal.indirect.costates import report

if TYPE_CHECKING:
    from optimal.paths.corridors import Corridor

MAX_GAP, TIME_BUDGET = 1e-3, 5.0
"""Largest relative gap between flight time and lower bound that the proof aims at, and its time limit [s]."""
METHODS: dict[str, dict[str, Any]] = {
    "shooting": {"windings": WINDINGS, "starts": STARTS, "seed": 0, "nodes": NODES},
    "flat": {"windings": WINDINGS, "corridor": None, "checks": "certified", "intervals": None, "callback": None},
    "pontryagin": {"windings": WINDINGS},
}
"""The methods, each with its options and their defaults."""
PROVEN_GAP = 1e-3
"""Largest relative gap of a flight that counts as proven optimal."""
CERTIFIED = (Status.LOCALLY_OPTIMAL, Status.CERTIFIED)
"""Statuses of a candidate that need a certificate that holds."""
WITH_FLIGHT = (*CERTIFIED, Status.LIMITS_AT_NODES_ONLY)
"""Statuses of a candidate that has a flight time."""


def solve(
    problem: ScenarioLike,
    method: str = "shooting",
    *,
    windings: Sequence[int] = WINDINGS,
    starts: int = STARTS,
    seed: int = 0,
    nodes: int = NODES,
    corridor: str | Corridor | None = None,
    checks: str = "certified",
    intervals: int | None = None,
    callback: Callable[[Any], object] | None = None,
    max_gap: float | None = MAX_GAP,
    time_budget: float = TIME_BUDGET,
    raise_on_failure: bool = True,
) -> Solution:
    """Return the fastest flight of a scenario from exact rest to exact rest.

    Args:
        problem: a scenario or its name.
        method: "shooting" (direct multiple shooting with the exact step), "flat" (the paper's eq. (10), in
            corridors of outer paths) or "pontryagin" (the indirect method of the paper's reference [8]; no hoops, floor
            or ceiling).
        windings: whole turns of the tilt to try.
        starts: starts for each winding, the first from the default guess, the others random, and twice as many where
            none converges; shooting only.
        seed: seed of the random guesses.
        nodes: steps of the whole flight; shooting only.
        corridor: "flight": corridors around a flight, first one of coarse shooting, then the one found in the corridor
            before; "fixed": the paper's outer paths where it prints them, else automatic ones, from the paper's slow
            start (section II-E); or an own `optimal.Corridor`, from the same start. By default "flight", and "fixed"
            with checks="nodes" or intervals; flat only.
        checks: "certified", or "nodes" for limits at grid nodes only, as published, in a fixed corridor; flat only.
        intervals: intervals of the first grid in a fixed corridor, None for the default of `plan`; flat only.
        callback: called with each corridor around a flight and the flight found in it, a
            `optimal.flat.moving_corridor.CorridorStep`; flat only.
        max_gap: relative gap that the proven lower bound aims at; None leaves the projection bound.
        time_budget: time limit of the proof [s], after which the bound proven by then is returned. It ends between two
            evaluations of the bound; one takes up to 20 s with sixteen hoops. It does not limit the search for the
            flight, which takes 0.1 s with one hoop and 6 s with sixteen.
        raise_on_failure: raise SolveFailed instead of returning a solution without a flight time.

    Raises:
        SolveFailed: with the problem and the result, when no certified flight was found.
        ValueError: for an unknown scenario or method, a scenario or an option that the method does not take, an own
            corridor that does not lead through the scenario, no windings or starts, or a gap or budget that is not
            positive.
    """
    task = scenario(problem)
    choice("method", method, METHODS)
    given = {
        "windings": tuple(windings), "starts": starts, "seed": seed, "nodes": nodes, "corridor": corridor,
        "checks": checks, "intervals": intervals, "callback": callback,
    }  # fmt: skip
    _require_options(method, given)
    around_flight = _around_flight(corridor, checks, intervals)
    if max_gap is not None:
        # Imported here, because it needs numba, which takes longer to import than everything else.
        from optimal.proof.lower_bound import require_positive

        require_positive(max_gap, time_budget)
    begun = time.perf_counter()
    with lost_calls() as lost:
        try:
            if method == "flat" and around_flight:
                candidate = by_flat_method(task, windings, callback)
            elif method == "flat":
                candidate = in_fixed_corridor(task, corridor, checks, intervals)
            elif method == "pontryagin":
                candidate = by_pontryagin(task, windings)
            else:
                candidate = by_shooting(task, windings, starts, seed, nodes)
            candidate, certificate = _certified(task, candidate)
        except SolverLost:
            candidate, certificate = Candidate(None, Status.NOT_CONVERGED), certify(None, task)
    solve_time = time.perf_counter() - begun
    status, reason = candidate.status, candidate.reason
    if status in CERTIFIED and not certificate.holds():
        status, reason = Status.NOT_CERTIFIED, certificate.shortfall()
    duration = candidate.flight.duration if candidate.flight and status in WITH_FLIGHT else math.inf
    if max_gap is not None and math.isfinite(duration):
        bound = max(_lower_bound(task, candidate.shot, max_gap, time_budget), certificate.lower_bound)
        certificate = replace(certificate, lower_bound=bound, gap=duration / bound - 1)
    if status in CERTIFIED and certificate.gap <= PROVEN_GAP * (1 + 1e-9):
        status = Status.OPTIMAL
    # Without a call that did not return, it is not known whether the optimiser finds a flight.
    known = "" if math.isfinite(duration) or (lost and candidate.flight is None) else reason
    solution = Solution(
        scenario=task,
        method=method,
        time=duration,
        status=status,
        winding=candidate.winding,
        trajectory=candidate.flight,
        certificate=certificate,
        iterations=candidate.iterations,
        solve_time=solve_time,
        starts=candidate.starts,
        agreed=candidate.agreed,
        reason=" ".join(filter(None, [known, str(lost)])),
        start=candidate.start,
        corridors=candidate.corridors,
    )
    if raise_on_failure and not math.isfinite(duration):
        raise SolveFailed(task, solution)
    return solution


def _require_options(method: str, given: dict[str, Any]) -> None:
    """Refuse options of other methods, unless they have their default."""
    for name, value in given.items():
        takers = [other for other, options in METHODS.items() if name in options]
        if method not in takers and value != METHODS[takers[0]][name]:
            taken = ", ".join(METHODS[method])
            raise ValueError(
                f"{name}={value!r} is an option of {' and '.join(takers)}; method {method!r} takes {taken}: leave "
                f"{name} out, or use another method"
            )


def _around_flight(corridor: str | Corridor | None, checks: str, intervals: int | None) -> bool:
    """Return whether the flat method lays corridors around flights; refuse options of fixed corridors with them."""
    as_published = checks != "certified" or intervals is not None
    if corridor is not None and not isinstance(corridor, str):
        return False
    if corridor not in (None, "flight", "fixed"):
        raise ValueError(f'corridor must be "flight", "fixed" or an optimal.Corridor, got {corridor!r}')
    if corridor == "flight" and as_published:
        raise ValueError(
            f"checks={checks!r} and intervals={intervals!r} are options of corridor='fixed': leave them out, or use it"
        )
    return corridor == "flight" or (corridor is None and not as_published)


def _certified(task: Scenario, candidate: Candidate) -> tuple[Candidate, Certificate]:
    """Return a candidate with its certificate; small violations of a flight by shooting are repaired."""
    certificate = candidate.certificate or certify(candidate.flight, task)
    shot, drift = candidate.shot, candidate.hamiltonian_drift
    if shot is not None:
        if not certificate.holds():
            shot, certificate = tighten(task, shot, certificate)
            candidate = replace(candidate, flight=shot.trajectory, shot=shot)
        drift = report(shot, task).hamiltonian_drift
    return candidate, replace(certificate, hamiltonian_drift=drift)


def _lower_bound(task: Scenario, shot: ShootingSolution | None, max_gap: float, time_budget: float) -> float:
    """Return a proven lower bound of the flight time [s], from the costates of a flight; None searches for one."""
    from optimal.proof.lower_bound import prove, prove_near

    if shot is None:
        return prove(task, max_gap=max_gap, time_budget=time_budget).time
    return prove_near(distinct_hoops(task, shared=False), shot, max_gap=max_gap, time_budget=time_budget).time
