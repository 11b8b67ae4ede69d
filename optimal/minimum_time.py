"""The front door: a scenario in, a certified optimum out, by the road of one's choice."""

from __future__ import annotations

import difflib
import math
import time
from collections.abc import Sequence
from dataclasses import replace

from flatgym.scenarios.catalogue import ScenarioLike, scenario
from flatgym.scenarios.scenario import Scenario
from optimal.direct.clearance import tighten
from optimal.direct.feasibility import beyond_horizon, impossible, suspect
from optimal.direct.multistart import AGREEMENT, STARTS, Search, search
from optimal.direct.program import NODES
from optimal.direct.shooting import WINDINGS, ShootingSolution
from optimal.flights.certificate import certify
from optimal.flights.solution import Solution, SolveFailed, Status
from optimal.indirect.costates import report

MAX_GAP, TIME_BUDGET = 1e-3, 5.0
"""How close to a flight its lower bound is to come, relatively, and the time granted for the proof [s]."""
METHODS = ("shooting", "flat", "pontryagin")
FLYABLE = (Status.SOLVED, Status.FEASIBLE, Status.LIMITS_AT_NODES_ONLY)
"""How a solve may end that has something to show."""


def solve(
    problem: ScenarioLike,
    method: str = "shooting",
    *,
    windings: Sequence[int] = WINDINGS,
    starts: int = STARTS,
    seed: int = 0,
    nodes: int = NODES,
    checks: str = "certified",
    intervals: int | None = None,
    max_gap: float | None = MAX_GAP,
    time_budget: float = TIME_BUDGET,
    raise_on_failure: bool = True,
) -> Solution:
    """Return the fastest flight of a scenario from exact rest to exact rest.

    Args:
        problem: a scenario or its name.
        method: "shooting" (direct multiple shooting with the exact step), "flat" (the paper's eq. (10),
            between its own outer paths where it prints some, else automatic ones) or "pontryagin" (the
            indirect road of the paper's reference [8]; no hoops, floor or ceiling).
        windings: whole turns to try; not flat.
        starts: starts for each winding, the first plain and the others drawn; shooting only.
        seed: seed of the drawn starts.
        nodes: steps of the whole flight; shooting only.
        checks: "certified", or "nodes" for the flat road as published; flat only.
        intervals: pieces of the flat functions on the first grid, None for `plan`'s; flat only.
        max_gap: how close to the flight a lower bound is to be proven, relatively; None leaves that of thrust alone.
        time_budget: when to stop proving [s], with the bound proven by then.
        raise_on_failure: raise SolveFailed rather than return a solution that is not solved.

    Raises:
        SolveFailed: with the problem and the result, when no certified flight was found.
        ValueError: for an unknown scenario or method, or a scenario the method cannot take, saying why; for a gap or
            budget that is not positive.
    """
    task = scenario(problem)
    if method not in METHODS:
        near = difflib.get_close_matches(str(method), METHODS, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"unknown method {method!r}; known: {', '.join(METHODS)}{hint}")
    begun, shot = time.perf_counter(), None
    if method == "flat":
        solution = _flat(task, checks, intervals, begun)
    elif method == "pontryagin":
        solution = _pontryagin(task, windings, begun)
    else:
        solution, shot = _shooting(task, windings, starts, seed, nodes, begun)
    if max_gap is not None and math.isfinite(solution.time):
        solution = bounded(solution, shot, max_gap, time_budget)
    if raise_on_failure and solution.status not in FLYABLE:
        raise SolveFailed(task, solution)
    return solution


def bounded(solution: Solution, shot: ShootingSolution | None, max_gap: float, time_budget: float) -> Solution:
    """Return a solution whose certificate holds a proven lower bound; see `optimal.proof.lower_bound.prove` for the arguments.

    Args:
        shot: the direct solution with its costates; None has one searched for.
    """
    # Here, because it leans on numba, which takes longer to import than all the rest.
    from optimal.proof.lower_bound import prove, prove_near

    if shot is None:
        proof = prove(solution.scenario, max_gap=max_gap, time_budget=time_budget)
    else:
        proof = prove_near(solution.scenario, shot, max_gap=max_gap, time_budget=time_budget)
    bound = max(proof.time, solution.certificate.lower_bound)
    certificate = replace(solution.certificate, lower_bound=bound, gap=solution.time / bound - 1)
    return replace(solution, certificate=certificate)


def _shooting(
    task: Scenario, windings: Sequence[int], starts: int, seed: int, nodes: int, begun: float
) -> tuple[Solution, ShootingSolution | None]:
    reason, distance = impossible(task), beyond_horizon(task)
    found = Search() if reason or distance else search(task, windings=windings, starts=starts, seed=seed, nodes=nodes)
    # Only the fastest counts: a slower flight that is certified would not be the optimum.
    chosen = found.shots[0] if found.shots else None
    certificate = certify(chosen.trajectory if chosen else None, task)
    if chosen and not certificate.holds():
        chosen, certificate = tighten(task, chosen, certificate)
    if chosen:
        certificate = replace(certificate, hamiltonian_drift=report(chosen, task).hamiltonian_drift)
        status = Status.SOLVED if certificate.holds() else Status.NOT_CERTIFIED
    else:
        status = Status.INFEASIBLE if reason else Status.NOT_CONVERGED
        reason = reason or distance or suspect(task)
    solution = Solution(
        scenario=task,
        method="shooting",
        time=chosen.trajectory.duration if chosen and status is Status.SOLVED else math.inf,
        status=status,
        winding=chosen.winding if chosen else 0,
        trajectory=chosen.trajectory if chosen else None,
        certificate=certificate,
        iterations=found.iterations,
        solve_time=time.perf_counter() - begun,
        starts=found.starts,
        agreed=found.agreed,
        reason=reason,
    )
    return solution, chosen


# The two other roads lean on SciPy, which takes longer to import than all the rest together.


def _flat(task: Scenario, checks: str, intervals: int | None, begun: float) -> Solution:
    from optimal.flat.planning import plan
    from optimal.flat.refinement import INTERVALS
    from optimal.paths.corridors import corridor, is_printed, paper_corridor

    outer_paths = paper_corridor(task) if is_printed(task) else corridor(task)
    size = INTERVALS if intervals is None else intervals
    found = plan(outer_paths.paths, task.quadrotor, ends=outer_paths.ends, checks=checks, intervals=size)
    certificate = certify(found.trajectory, task)
    if not found.converged:
        status = Status.NOT_CONVERGED
    elif checks == "nodes":
        status = Status.LIMITS_AT_NODES_ONLY
    elif not certificate.holds():
        status = Status.NOT_CERTIFIED
    else:
        status = Status.SOLVED if found.optimised else Status.FEASIBLE
    flight = found.trajectory
    return Solution(
        scenario=task,
        method="flat",
        time=found.time if status in FLYABLE else math.inf,
        status=status,
        winding=0 if flight is None else round(float(flight.state(flight.duration)[4]) / (2 * math.pi)),
        trajectory=flight,
        certificate=certificate,
        iterations=found.iterations,
        solve_time=time.perf_counter() - begun,
        starts=1,
        agreed=int(status in FLYABLE),
        reason="" if status in FLYABLE else found.status,
    )


def _pontryagin(task: Scenario, windings: Sequence[int], begun: float) -> Solution:
    from optimal.indirect.pontryagin import pontryagin

    extremals = [pontryagin(task, winding) for winding in windings]
    if not extremals:
        raise ValueError(f"needs at least one winding, got windings={windings!r}")
    best = min(extremals, key=lambda extremal: extremal.time)
    certificate = replace(certify(best.trajectory, task), hamiltonian_drift=best.hamiltonian_drift)
    if not best.converged:
        status = Status.NOT_CONVERGED
    else:
        status = Status.SOLVED if certificate.holds() else Status.NOT_CERTIFIED
    return Solution(
        scenario=task,
        method="pontryagin",
        time=best.time if status is Status.SOLVED else math.inf,
        status=status,
        winding=best.winding,
        trajectory=best.trajectory,
        certificate=certificate,
        iterations=sum(extremal.evaluations for extremal in extremals),
        solve_time=time.perf_counter() - begun,
        starts=len(extremals),
        agreed=sum(extremal.time <= best.time * (1 + AGREEMENT) for extremal in extremals),
        reason="" if status is Status.SOLVED else best.message,
    )
