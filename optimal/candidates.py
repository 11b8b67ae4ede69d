"""What the methods of `solve` return: the fastest flight each of them finds, before it is certified.

by_shooting              direct multiple shooting
by_flat_method           the flat method in corridors that follow the flight
in_fixed_corridor        the flat method in one corridor
by_pontryagin            Pontryagin's conditions
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from flatgym.scenarios.scenario import Scenario
from optimal.direct.feasibility import beyond_horizon, infeasibility_proof, infeasibility_suspect
from optimal.direct.multistart import AGREEMENT, search
from optimal.direct.shooting import ShootingSolution
from optimal.direct.transcription import distinct_hoops
from optimal.flights.certificate import Certificate
from optimal.flights.solution import Status
from optimal.flights.trajectory import Flight

if TYPE_CHECKING:
    from optimal.paths.corridors import Corridor


@dataclass(frozen=True)
class Candidate:
    """What a method returns, before it is certified.

    Attributes:
        flight: the fastest flight found; None if there is none.
        status: the status of the solution, unless it needs a certificate that does not hold.
        winding: whole turns of the tilt.
        iterations: of the solver, over all starts.
        starts: number of starts.
        agreed: number of starts that ended within AGREEMENT of the best time.
        reason: the obstacle, or the method's own message; reported without a flight only.
        shot: the flight with its costates; shooting only.
        certificate: the certificate of the flight, if the method has computed it.
        hamiltonian_drift: as in the certificate, if the method itself computes it.
        start: what the method started from, in words; flat only.
        corridors: the corridors that led to the flight, and the flights in them; flat only.
    """

    flight: Flight | None
    status: Status
    winding: int = 0
    iterations: int = 0
    starts: int = 0
    agreed: int = 0
    reason: str = ""
    shot: ShootingSolution | None = None
    certificate: Certificate | None = None
    hamiltonian_drift: float = math.inf
    start: str = ""
    corridors: tuple[Any, ...] = ()


def _obstacle(task: Scenario) -> Candidate | None:
    """Return the answer for a scenario that has no flight, or none that can be searched; None for the others."""
    if reason := infeasibility_proof(task):
        return Candidate(None, Status.INFEASIBLE, reason=reason)
    if reason := beyond_horizon(task):
        return Candidate(None, Status.NOT_CONVERGED, reason=reason)
    return None


def by_shooting(task: Scenario, windings: Sequence[int], starts: int, seed: int, nodes: int) -> Candidate:
    """Return the fastest flight that shooting finds; arguments as in `optimal.solve`."""
    if obstacle := _obstacle(task):
        return obstacle
    found = search(distinct_hoops(task), windings=windings, starts=starts, seed=seed, nodes=nodes)
    nothing = Candidate(
        None, Status.NOT_CONVERGED, iterations=found.iterations, starts=found.starts, agreed=found.agreed
    )
    if not found.shots:
        return replace(nothing, reason=infeasibility_suspect(task))
    # Only the fastest flight counts: a slower one that is certified would not be the optimum.
    shot = found.shots[0]
    return replace(nothing, flight=shot.trajectory, status=Status.LOCALLY_OPTIMAL, winding=shot.winding, shot=shot)


# The two other methods need SciPy, which takes longer to import than everything else here.


def by_flat_method(task: Scenario, windings: Sequence[int], callback: Callable[[Any], object] | None) -> Candidate:
    """Return the fastest flight of the flat method in corridors around flights; arguments as in `optimal.solve`."""
    from optimal.flat.search import search as search_corridors

    if obstacle := _obstacle(task):
        return obstacle
    flown = distinct_hoops(task)
    found = search_corridors(flown, windings, callback)
    if not found.steps:
        if found.starts:
            reason = f"no certified flight was found in the corridors around {found.starts} coarse flights of shooting."
        else:
            reason = infeasibility_suspect(task)
        return Candidate(None, Status.NOT_CONVERGED, starts=found.starts, reason=reason)
    last = found.steps[-1]
    return Candidate(
        last.solution.trajectory,
        Status.LOCALLY_OPTIMAL if last.solution.optimised else Status.CERTIFIED,
        winding=found.winding,
        iterations=sum(step.solution.iterations for step in found.steps),
        starts=found.starts,
        agreed=found.agreed,
        certificate=last.certificate if flown is task else None,
        start=f"a flight of shooting on the coarse grid, winding {found.winding}",
        corridors=found.steps,
    )


def in_fixed_corridor(task: Scenario, own: str | Corridor | None, checks: str, intervals: int | None) -> Candidate:
    """Return the fastest flight of the flat method in one corridor, the paper's or one's own.

    Args:
        task: the scenario.
        own: a corridor, or "fixed" or None for the paper's where it prints one, else an automatic one.
        checks, intervals: as in `optimal.solve`.
    """
    from optimal.flat.planning import plan
    from optimal.flat.refinement import INTERVALS
    from optimal.paths.corridors import corridor, is_printed, paper_corridor
    from optimal.paths.passage import require_passage

    if own is not None and not isinstance(own, str):
        require_passage(own, task)
        outer_paths = own
    else:
        outer_paths = paper_corridor(task) if is_printed(task) else corridor(task)
    size = INTERVALS if intervals is None else intervals
    found = plan(outer_paths.paths, task.quadrotor, ends=outer_paths.ends, checks=checks, intervals=size)
    if not found.converged:
        status = Status.NOT_CONVERGED
    elif checks == "nodes":
        status = Status.LIMITS_AT_NODES_ONLY
    else:
        status = Status.LOCALLY_OPTIMAL if found.optimised else Status.CERTIFIED
    flight = found.trajectory
    return Candidate(
        flight,
        status,
        winding=0 if flight is None else round(float(flight.state(flight.duration)[4]) / (2 * math.pi)),
        iterations=found.iterations,
        starts=1,
        agreed=int(found.converged),
        reason=found.status,
        start="the slow motion along the central path",
    )


def by_pontryagin(task: Scenario, windings: Sequence[int]) -> Candidate:
    """Return the fastest flight that fulfils Pontryagin's conditions; arguments as in `optimal.solve`."""
    from optimal.indirect.pontryagin import pontryagin

    extremals = [pontryagin(task, winding) for winding in windings]
    if not extremals:
        raise ValueError(f"needs at least one winding, got windings={windings!r}")
    best = min(extremals, key=lambda extremal: extremal.time)
    direct = min(extremals, key=lambda extremal: extremal.direct_time)
    reason = best.message
    # A direct solution is a flight, so an extremal that takes longer is not the fastest.
    if beaten := best.converged and direct.direct_time < best.time * (1 - AGREEMENT):
        reason = (
            f"The direct solution of winding {direct.winding} takes {direct.direct_time:.6g} s, but Pontryagin's "
            f'conditions were not solved for it, only for a flight of {best.time:.6g} s; use method="shooting".'
        )
    return Candidate(
        best.trajectory,
        Status.LOCALLY_OPTIMAL if best.converged and not beaten else Status.NOT_CONVERGED,
        best.winding,
        iterations=sum(extremal.evaluations for extremal in extremals),
        starts=len(extremals),
        agreed=sum(extremal.time <= best.time * (1 + AGREEMENT) for extremal in extremals),
        reason=reason,
        hamiltonian_drift=best.hamiltonian_drift,
    )
