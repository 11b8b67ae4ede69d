"""Replanning: the fewest steps to the goal from any state, starting from a flight that passes near it.

    flight = fewest_steps("hoop")
    task = RemainingTask.of(flight.scenario, state, hoops_passed=0)
    replan(task, remaining_trajectory(flight, k, flight.scenario), flight.winding)

A scenario joined in flight differs from the original in its start state only. The program of K steps serves unchanged.
The remaining part of a nearby flight is the first guess, and its length is the first K. K decreases as long as a
flight is found. If none is found at the first K, K grows in increasing strides until one is.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.direct.solver_process import SolverLost, lost_calls
from optimal.discrete.fewest_steps import FewestSteps
from optimal.discrete.fixed_steps import StepSolution, solve_in_steps
from optimal.flights.trajectory import Trajectory

STRIDES = (0, 1, 1, 2, 4, 8)
"""Steps added to K at each attempt, until a flight is found."""
MAX_TOLERANCE_USED = 0.6
"""One step less is tried only where a flight uses less than this share of the tolerance. A step is worth about 0.65 of
the tolerance, and no shorter flight was ever found beyond this share."""


@dataclass(frozen=True)
class RemainingTask(Scenario):
    """A scenario joined in flight, with the hoops still to pass.

    Attributes:
        state: the present state x, z, vx, vz, theta, as in `Scenario.start_state`.
    """

    state: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @classmethod
    def of(cls, scenario: Scenario, state: Array, hoops_passed: int = 0) -> RemainingTask:
        """Return what remains of a scenario at a state (5,) after a number of hoops."""
        values = {field.name: getattr(scenario, field.name) for field in fields(Scenario)}
        if hoops_passed:  # the last hoop passed replaces the start
            values["start"] = tuple(scenario.hoops[hoops_passed - 1].centre.tolist())
        values["hoops"] = scenario.hoops[hoops_passed:]
        return cls(**values, state=tuple(np.asarray(state, dtype=np.float64).tolist()))

    @property
    def start_state(self) -> Array:
        """The present state, shape (5,)."""
        return np.array(self.state)


def remaining_trajectory(flight: FewestSteps | StepSolution, step: int, scenario: Scenario) -> Trajectory:
    """Return the part of a scenario's flight after a number of steps; at least its last step."""
    step = min(step, len(flight.actions) - 1)
    controls = scenario.quadrotor.control(flight.actions[step:])
    return Trajectory(scenario.dt * np.arange(len(controls) + 1.0), flight.states[step:], controls, scenario.quadrotor)


def replan(
    task: RemainingTask, like: Trajectory, winding: int, strides: Sequence[int] = STRIDES
) -> StepSolution | None:
    """Return the flight in the fewest steps found near another one; None if none is found.

    The search ends when calls of the solver do not return.

    Args:
        task: the remaining task.
        like: a flight from a nearby state through the same hoops to the goal, in steps of `task.dt`.
        winding: whole turns at its end, counted as its tilt is.
        strides: as STRIDES; fewer strides give up earlier.
    """
    best: StepSolution | None = None
    with lost_calls(), suppress(SolverLost):
        count, found = max(len(like.controls), 1), None
        for stride in strides:
            count = min(count + stride, task.max_steps)
            found = solve_in_steps(task, like, winding, count, neighbours=())
            if found is not None:
                break
        while found is not None:
            best = found
            shorter = best.tolerance_used <= MAX_TOLERANCE_USED and len(best.actions) > 1
            found = solve_in_steps(task, like, winding, len(best.actions) - 1, neighbours=()) if shorter else None
    return best
