"""The result of the flat method, with its status in words."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from optimal.flat.limits import constraint_violation
from optimal.flat.problem import Iterate, PlanningProblem
from optimal.flat.program.solver import SUCCESS
from optimal.flat.trajectory import FlatTrajectory


@dataclass(frozen=True, eq=False)
class FlatSolution:
    """The result of `plan` and `follow`.

    Attributes:
        time: duration of the motion [s]; inf unless converged.
        status: how the solve ended and what to do about it, a sentence.
        converged: whether time and trajectory may be used as the status says.
        optimised: True: the motion is the optimiser's. False: it is a feasible motion along the central path.
        iterations: Ipopt iterations of all solves that led here.
        solve_time: wall time [s].
        trajectory: the motion; None unless converged.
        violation: largest violation of a limit in continuous time, relative to its scale; inf without a
            trajectory.
        intervals: number of grid intervals.
        first_time: duration on the first grid, where limits may be violated between checks [s].
    """

    time: float
    status: str
    converged: bool
    optimised: bool
    iterations: int
    solve_time: float
    trajectory: FlatTrajectory | None
    violation: float
    intervals: int
    first_time: float


def assessed(
    problem: PlanningProblem,
    iterate: Iterate,
    flight: FlatTrajectory | None,
    begun: float,
    first_time: float,
    optimised: bool = True,
) -> FlatSolution:
    """Return the solution of a finished solve. Its time is finite only for a motion that passed the checks.

    Args:
        problem: the problem.
        iterate: the last iterate.
        flight: the motion within the limits; None if none was found.
        begun: start of the solve, from `time.perf_counter` [s].
        first_time: duration on the first grid [s].
        optimised: whether the motion is the optimiser's.
    """
    size = len(iterate.nodes) - 1
    ended = "" if iterate.outcome in SUCCESS else f" (Ipopt stopped with {iterate.outcome})"
    way_out = "start on another number of intervals, or use outer paths that leave more room"
    if flight is None or (not problem.certified and ended):
        flight = None
        status = f"Not solved: no motion within the limits was found on {size} intervals{ended}; {way_out}."
    elif not problem.certified:
        status = (
            "Limits hold at grid nodes only, as published. Between nodes the largest violation is "
            f"{constraint_violation(flight):.3g} times the limit, so this is not a flight. Use "
            'checks="certified" for one.'
        )
    elif optimised:
        status = f"Solved: limits hold in continuous time, on {size} intervals."
    else:
        status = (
            "Feasible, not optimal: limits hold in continuous time near the central path, but the optimiser found "
            f"nothing better on {size} intervals{ended}; {way_out}."
        )
    return FlatSolution(
        time=math.inf if flight is None else flight.duration,
        status=status,
        converged=flight is not None,
        optimised=flight is not None and optimised,
        iterations=iterate.iterations,
        solve_time=time.perf_counter() - begun,
        trajectory=flight,
        violation=math.inf if flight is None else constraint_violation(flight),
        intervals=size,
        first_time=first_time,
    )
