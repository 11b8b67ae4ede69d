"""Replanning: the fewest steps from any state, beginning with a flight that came by near it.

    flight = fewest_steps("hoop")
    replan(Underway.of(scenario, state, hoops_passed=0), rest(flight, k), flight.winding)

A scenario joined in flight is a scenario whose first state is not at rest, so the program of K steps serves
unchanged. What remains of a flight nearby is its first guess and says about how many steps to expect; from there
K goes down as long as a flight is found, else up in growing strides until one is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.discrete.fewest_steps import FewestSteps, StepSolution, solve_in_steps
from optimal.flights.trajectory import Trajectory

STRIDES = (0, 1, 1, 2, 4, 8)
"""How many steps more are tried each time that no flight is found."""
NEAR = 0.6
"""Where a flight uses more than this share of the tolerance, one step less is not tried: a step is worth about 0.65 of
the tolerance, and none was ever found there."""


@dataclass(frozen=True)
class RemainingTask(Scenario):
    """A scenario joined in flight, with the hoops still to pass.

    Attributes:
        state: where the flight is: x, z, vx, vz, theta, as in `Scenario.start_state`.
    """

    state: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @classmethod
    def of(cls, scenario: Scenario, state: Array, hoops_passed: int = 0) -> RemainingTask:
        """Return what is left of a scenario at a state (5,) with so many hoops passed."""
        values = {field.name: getattr(scenario, field.name) for field in fields(Scenario)}
        if hoops_passed:  # the flight departs from the last of them
            values["start"] = tuple(scenario.hoops[hoops_passed - 1].centre.tolist())
        values["hoops"] = scenario.hoops[hoops_passed:]
        return cls(**values, state=tuple(np.asarray(state, dtype=np.float64).tolist()))

    @property
    def start_state(self) -> Array:
        """The state in which the flight is joined, shape (5,)."""
        return np.array(self.state)


def rest(flight: FewestSteps | StepSolution, step: int, scenario: Scenario) -> Trajectory:
    """Return what a flight of a scenario flies after so many steps; of one that is over, its last step."""
    step = min(step, len(flight.actions) - 1)
    controls = scenario.quadrotor.control(flight.actions[step:])
    return Trajectory(scenario.dt * np.arange(len(controls) + 1.0), flight.states[step:], controls, scenario.quadrotor)


def replan(
    task: RemainingTask, like: Trajectory, winding: int, strides: Sequence[int] = STRIDES
) -> StepSolution | None:
    """Return the flight in the fewest steps found near another one, from where the task stands; None if none is found.

    Args:
        task: what is left to fly.
        like: a flight from about there through the same hoops to the goal, in steps of `task.dt`.
        winding: whole turns at its end, counted as its tilt is.
        strides: as STRIDES; fewer give up sooner.
    """
    count, found = max(len(like.controls), 1), None
    for stride in strides:
        count = min(count + stride, task.max_steps)
        found = solve_in_steps(task, like, winding, count)
        if found is not None:
            break
    best = found
    while found is not None:
        best = found
        sooner = best.tolerance_used <= NEAR and len(best.actions) > 1
        found = solve_in_steps(task, like, winding, len(best.actions) - 1) if sooner else None
    return best
