"""What a solver returns: a time only where a certified flight stands behind it, else a reason."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from flatgym.scenarios.scenario import Scenario
from optimal.flights.certificate import Certificate
from optimal.flights.trajectory import Flight


class Status(StrEnum):
    """How a solve ended, as a sentence that says what to do about it."""

    SOLVED = "Solved: the flight is certified within its limits in continuous time."
    BEST_KNOWN = "Solved: these actions replay in the environment to the goal; no flight in fewer steps was found."
    PROVEN = "Solved: these actions replay in the environment to the goal, and no flight whatever needs fewer steps."
    FEASIBLE = (
        "Feasible, not optimal: the flight is certified within its limits in continuous time, but the optimiser "
        "found none better than near the central path; try another number of intervals, or another method."
    )
    INFEASIBLE = "Not solved: no flight of this scenario exists."
    NOT_CONVERGED = (
        "Not solved: the optimiser did not converge from any start; try more starts or other windings, "
        "and check that goal and hoops can be reached between floor and ceiling."
    )
    NOT_CERTIFIED = (
        "Not solved: the optimiser converged, but its fastest flight breaks a limit between the nodes, as the "
        "certificate says; solve again with more nodes or intervals."
    )
    LIMITS_AT_NODES_ONLY = (
        "Not a flight: limits hold at the grid nodes only, as published; see the certificate for the violation "
        "between them."
    )
    NO_STEPS_FOUND = (
        "Not solved: no flight was found in the number of steps tried; raise the time limit or check the scenario."
    )
    BROKEN_OFF = "Not solved: the computation broke off with an error."


class SolveFailed(RuntimeError):
    """A solve ended without a certified flight; `problem` is the scenario, `result` what there is."""

    def __init__(self, problem: Scenario, result: Any) -> None:
        self.problem, self.result = problem, result
        super().__init__(" ".join(filter(None, [f"{problem.name!r}: {result.status}", result.reason])))


@dataclass(frozen=True)
class Solution:
    """The answer of `optimal.solve`.

    Attributes:
        scenario: what was to be flown.
        method: "shooting", "flat" or "pontryagin".
        time: flight time from rest to rest [s]; inf unless `status` says solved, or feasible.
        status: how the solve ended, a sentence.
        winding: whole turns of the tilt between start and goal.
        trajectory: the flight; None where there is none.
        certificate: what was shown of the flight, independently of the solver.
        iterations: of Ipopt, over all starts.
        solve_time: wall time of search and certificate, the proof of the lower bound aside [s].
        starts: starts tried, over all windings.
        agreed: how many of them ended within 1e-4 of the best time.
        reason: where there is no flight, what stands in its way; else empty.
    """

    scenario: Scenario
    method: str
    time: float
    status: Status
    winding: int
    trajectory: Flight | None
    certificate: Certificate
    iterations: int
    solve_time: float
    starts: int
    agreed: int
    reason: str = ""

    @property
    def solved(self) -> bool:
        """Whether a certified flight stands behind `time`."""
        return self.status is Status.SOLVED

    def row(self) -> dict[str, Any]:
        """Return the solver row of the benchmark's tables: plain names and numbers."""
        return {
            "scenario": self.scenario.name,
            "method": self.method,
            "time_s": self.time,
            "winding": self.winding,
            "status": self.status.value,
            "iterations": self.iterations,
            "solve_time_s": self.solve_time,
            "lower_bound_s": self.certificate.lower_bound,
            **{name: value for name, value in self.certificate.row().items() if name != "lower_bound"},
        }
