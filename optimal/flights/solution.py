"""The answer of a solve: a certified flight and its time, or a reason why there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Self

from flatgym.scenarios.scenario import Scenario
from optimal.flights.certificate import Certificate
from optimal.flights.trajectory import Flight


class Status(StrEnum):
    """How a solve ended: a sentence, with advice where it failed.

    The flights of `solve` are certified (CERTIFIED), also locally optimal (LOCALLY_OPTIMAL), or also proven (OPTIMAL).
    """

    OPTIMAL = "Solved: the flight is certified in continuous time, and proven optimal: its gap is at most 0.1 %."
    LOCALLY_OPTIMAL = (
        "Solved: the flight is certified in continuous time, and locally optimal; its gap bounds how much faster "
        "another one may be."
    )
    CERTIFIED = (
        "Certified, not optimal: the flight keeps its limits in continuous time, but the optimiser found none better "
        "than one near the central path; try another number of intervals or another method."
    )
    BEST_KNOWN = "Solved: these actions replay in the environment to the goal; no flight in fewer steps was found."
    PROVEN = "Solved: these actions replay in the environment to the goal, and no flight whatever needs fewer steps."
    INFEASIBLE = "Not solved: no flight of this scenario exists."
    NOT_CONVERGED = (
        "Not solved: the optimiser did not converge from any start; try more starts or other windings, "
        "and check that goal and hoops can be reached between floor and ceiling."
    )
    NOT_CERTIFIED = (
        "Not solved: the optimiser converged, but the certificate of its fastest flight does not hold; solve again "
        "with more nodes or intervals."
    )
    LIMITS_AT_NODES_ONLY = (
        "Not a flight: limits hold at the grid nodes only, as in the paper; see the certificate for the violation "
        "between the nodes."
    )
    NO_STEPS_FOUND = (
        "Not solved: no flight was found in the number of steps tried; raise the time limit or check the scenario."
    )
    INTERRUPTED = "Not solved: the computation was interrupted by an error; see the reason."


class SolveFailed(RuntimeError):
    """A solve ended without a certified flight; `problem` is the scenario, `result` the incomplete answer."""

    def __init__(self, problem: Scenario, result: Any) -> None:
        self.problem, self.result = problem, result
        super().__init__(" ".join(filter(None, [f"{problem.name!r}: {result.status}", result.reason])))


@dataclass(frozen=True)
class Solution:
    """The answer of `optimal.solve`.

    Attributes:
        scenario: the task.
        method: "shooting", "flat" or "pontryagin"; "none" if the computation was interrupted.
        time: flight time from rest to rest [s]; inf unless the status is OPTIMAL, LOCALLY_OPTIMAL, CERTIFIED or
            LIMITS_AT_NODES_ONLY.
        status: how the solve ended, a sentence. A local optimum of the flat method is one between its outer paths.
        winding: whole turns of the tilt between start and goal.
        trajectory: the flight; None if there is none.
        certificate: properties of the flight, checked independently of the solver.
        iterations: of the solver, over all starts (Fatrop for shooting, Ipopt for flat; evaluations for pontryagin).
        solve_time: wall time of method and certificate, without the proof of the lower bound [s].
        starts: number of starts, over all windings.
        agreed: number of starts that ended within 1e-4 of the best time.
        reason: without a flight time, the obstacle; in any case the number of the solver's calls that did not return;
            else empty.
        start: what the flat method started from, in words.
        corridors: the corridors that led to the flight of the flat method, each with the flight in it.
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
    start: str = ""
    corridors: tuple[Any, ...] = ()

    @property
    def solved(self) -> bool:
        """Whether `time` is that of a certified flight that is locally optimal, or proven optimal."""
        return self.status in (Status.OPTIMAL, Status.LOCALLY_OPTIMAL)

    @property
    def headline(self) -> str:
        """The answer in one line: certified, locally optimal and proven are said apart."""
        if not (self.solved or self.status is Status.CERTIFIED):
            return self.status.value
        proven = f"proven within {self.proven_within}" if self.certificate.lower_bound > 0 else "nothing proven"
        return f"Certified flight in {self.time:.4f} s, {self.optimality}; {proven}."

    @property
    def optimality(self) -> str:
        """How far the flight is optimal, in words."""
        if self.status is Status.OPTIMAL:
            return "optimal"
        if self.status is Status.LOCALLY_OPTIMAL:
            return "locally optimal between its outer paths" if self.method == "flat" else "locally optimal"
        return "not optimal"

    @property
    def proven_within(self) -> str:
        """The gap in percent, rounded upwards, such as "0.02 %"."""
        digits = 2 if self.certificate.gap < 0.01 else 1
        return f"{math.ceil(self.certificate.gap * 10 ** (2 + digits) - 1e-6) / 10**digits:.{digits}f} %"

    @classmethod
    def failed(cls, scenario: Scenario, status: Status, reason: str = "") -> Self:
        """Return the answer without a flight."""
        return cls(scenario, "none", math.inf, status, 0, None, Certificate(), 0, math.inf, 0, 0, reason)

    def row(self) -> dict[str, Any]:
        """Return the row of the solver tables: plain names and numbers."""
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
