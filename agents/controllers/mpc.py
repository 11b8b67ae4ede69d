"""Shrinking-horizon MPC: the fewest steps to the goal, replanned from the current state.

    MPC(fewest_steps("hoop")).predict(observation)            # one vehicle, a plan at every step
    replans_along(flight, states, hoops_passed, every=8)      # plans from the states of another flight

The LQR of `agents.controllers.tracking` returns to a given flight. The MPC computes the optimal flight from the current
state. The remainder of the previous plan is the initial guess, which leaves a few iterations
(`optimal.discrete.replanning`). If no plan is found, the LQR tracks the original flight.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.controllers.tracking import Expert, absolute_state, steps_flown
from flatgym.quadrotor import Array, nearest_turn
from flatgym.scenarios.scenario import Scenario
from flatgym.task.observation import DecodedObservation, decode_observation
from optimal.discrete.fewest_steps import FewestSteps
from optimal.discrete.fixed_steps import StepSolution
from optimal.discrete.replanning import RemainingTask, remaining_trajectory, replan

STRIDES = (0, 2, 4, 8, 16)
"""Growth of the horizon in `replans_along` when no plan is found, as in `optimal.discrete.replanning`.

They grow fast because a policy that lingers near the goal soon lags by the length of its plan.
"""


class Continuation(NamedTuple):
    """A plan from the state after `step` steps with `hoops_passed`: its states (K+1, 5) and actions (K, 2)."""

    step: int
    hoops_passed: int
    states: Array
    actions: NDArray[np.float32]


def replans_along(
    flight: FewestSteps, states: Array, hoops_passed: NDArray[np.int64], every: int = 8, since: int = 0
) -> Iterator[Continuation]:
    """Yield plans from states of another flight of the same scenario, until one search fails.

    Args:
        flight: the optimal flight of the scenario; it is the initial guess of the first plan.
        states: states of the other flight, tilt not wrapped, shape (T, 5).
        hoops_passed: hoops passed at these states, shape (T,).
        every: steps between plans.
        since: step of the first plan, at least 1.
    """
    plan, planned_at, scenario = StepSolution(flight.actions, flight.states, flight.winding, 0.0), 0, flight.scenario
    for step in range(max(1, since), len(states), every):
        passed, left = int(hoops_passed[step]), remaining_trajectory(plan, step - planned_at, scenario)
        found = replan(RemainingTask.of(scenario, states[step], passed), left, plan.winding, STRIDES)
        if found is None:  # later states are no closer to a plan, and failed searches take longest
            return
        plan, planned_at = found, step
        yield Continuation(step, passed, found.states, found.actions)


class MPC:
    """Model predictive control of one vehicle: a new plan at every step.

    Args:
        flight: the result of `optimal.fewest_steps` from the scenario's start.

    Raises:
        ValueError: for a result without a flight.
    """

    def __init__(self, flight: FewestSteps) -> None:
        self.flight, self.expert = flight, Expert(flight)
        self._start()

    def _start(self) -> None:
        self.plan, self.planned_at, self.passed = _as_plan(self.flight), 0, 0

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: Any = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for one observation of the flight's scenario, (19,) or (1, 19), and `state` unchanged.

        Raises:
            ValueError: for observations of several vehicles, because each needs its own plan.
        """
        seen = decode_observation(np.reshape(observation, (-1, np.shape(observation)[-1])))
        if len(seen.time) != 1:
            raise ValueError(f"an MPC flies one vehicle, got observations of {len(seen.time)}; make one for each")
        target = self.flight.scenario
        step = int(steps_flown(seen, target)[0])
        if step == 0:
            self._start()
        here = absolute_state(seen, target)[0]
        planned = self.plan.states[min(step - self.planned_at, len(self.plan.states) - 1)]
        here[4] = nearest_turn(here[4], planned[4])
        self.passed = next_hoop(target, seen, self.passed)
        found = None
        if step > 0:
            task = RemainingTask.of(target, here, self.passed)
            found = replan(task, remaining_trajectory(self.plan, step - self.planned_at, target), self.plan.winding)
        if found is not None:
            self.plan, self.planned_at = found, step
        lost = found is None and step > 0
        action = self.expert.action(here, np.array(step)) if lost else self.plan.actions[0]
        return np.broadcast_to(action, (*np.shape(observation)[:-1], 2)).copy(), state


def next_hoop(scenario: Scenario, seen: DecodedObservation, passed: int) -> int:
    """Return the number of hoops passed, from the next hoop that is observed and the number passed before."""
    for i in range(passed, len(scenario.hoops)):
        hoop = scenario.hoops[i]
        centre = np.array(scenario.goal) - seen.goal[0] + seen.hoops[0, 0]
        if seen.ahead[0, 0] and np.allclose(
            [*centre, *seen.directions[0, 0]], [*hoop.centre, *hoop.direction], atol=1e-2
        ):
            return i
    return len(scenario.hoops)


def _as_plan(flight: FewestSteps) -> StepSolution:
    return StepSolution(flight.actions, flight.states, flight.winding, flight.tolerance_used)
