"""The expert that plans anew: the fewest steps from wherever a flight has come to.

    Replanner(fewest_steps("hoop")).predict(observation)      # flies one vehicle, planning at every step
    continuations(flight, states, hoops_passed, every=8)      # what it would have flown from another's states

The regulator of `agents.controllers.tracking` returns to the flight it knows; this one asks what is optimal from here. Each plan
begins with the one before, less the step flown, so it takes a few iterations (`optimal.discrete.replanning`). Where none is
found, the plan before is flown on under its regulator.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.controllers.tracking import Expert, placed, steps_flown
from flatgym.quadrotor import Array, nearest_turn
from flatgym.scenarios.scenario import Scenario
from flatgym.task.decoding import DecodedObservation, decode_observation
from optimal.discrete.fewest_steps import FewestSteps, StepSolution
from optimal.discrete.replanning import RemainingTask, replan, rest

LONGER = (0, 2, 4, 8, 16)
"""Strides of `optimal.discrete.replanning` in `continuations`: who lingers near the goal is soon as late as his plan is long."""


class Continuation(NamedTuple):
    """A plan from the state of a flight after `step` steps with `hoops_passed`: its states (K+1, 5), actions (K, 2)."""

    step: int
    hoops_passed: int
    states: Array
    actions: NDArray[np.float32]


def continuations(
    flight: FewestSteps, states: Array, hoops_passed: NDArray[np.int64], every: int = 8, since: int = 0
) -> Iterator[Continuation]:
    """Yield the plans from every so many states of another flight of the same scenario, until none is found.

    Args:
        flight: the scenario's own optimal flight, near which the first plan is looked for.
        states: where the other flight was, tilt not wrapped, shape (T, 5).
        hoops_passed: the hoops it had passed there, shape (T,).
        every: steps between plans.
        since: step of the first of them, at its earliest 1.
    """
    plan, begun, scenario = StepSolution(flight.actions, flight.states, flight.winding, 0.0), 0, flight.scenario
    for step in range(max(1, since), len(states), every):
        passed, left = int(hoops_passed[step]), rest(plan, step - begun, scenario)
        found = replan(RemainingTask.of(scenario, states[step], passed), left, plan.winding, LONGER)
        if found is None:  # astray; further on it would be no nearer, and what fails takes longest
            return
        plan, begun = found, step
        yield Continuation(step, passed, found.states, found.actions)


class MPC:
    """A flight as a policy for one vehicle that plans anew at every step.

    Args:
        flight: what `optimal.fewest_steps` found, from the scenario's start.

    Raises:
        ValueError: for an answer without a flight.
    """

    def __init__(self, flight: FewestSteps) -> None:
        self.flight, self.expert = flight, Expert(flight)
        self._start()

    def _start(self) -> None:
        self.plan, self.begun, self.passed = StepSolution(*_flown(self.flight)), 0, 0

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: Any = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for an observation of its own scenario, (19,) or (1, 19), and the state it was given.

        Raises:
            ValueError: for observations of several vehicles, each of which would need a plan of its own.
        """
        seen = decode_observation(np.reshape(observation, (-1, np.shape(observation)[-1])))
        if len(seen.time) != 1:
            raise ValueError(f"a Replanner flies one vehicle, got observations of {len(seen.time)}; make one for each")
        target = self.flight.scenario
        step = int(steps_flown(seen, target)[0])
        if step == 0:
            self._start()
        here = placed(seen, target)[0]
        flown = self.plan.states[min(step - self.begun, len(self.plan.states) - 1)]
        here[4] = nearest_turn(here[4], flown[4])
        self.passed = next_hoop(target, seen, self.passed)
        found = None
        if step > 0:
            underway = RemainingTask.of(target, here, self.passed)
            found = replan(underway, rest(self.plan, step - self.begun, target), self.plan.winding)
        if found is not None:
            self.plan, self.begun = found, step
        lost = found is None and step > 0
        action = self.expert.action(here, np.array(step)) if lost else self.plan.actions[0]
        return np.broadcast_to(action, (*np.shape(observation)[:-1], 2)).copy(), state


def next_hoop(scenario: Scenario, seen: DecodedObservation, passed: int) -> int:
    """Return how many hoops of a scenario are passed, from what is seen next and how many were passed before."""
    for i in range(passed, len(scenario.hoops)):
        hoop = scenario.hoops[i]
        centre = np.array(scenario.goal) - seen.goal[0] + seen.hoops[0, 0]
        if seen.ahead[0, 0] and np.allclose(
            [*centre, *seen.directions[0, 0]], [*hoop.centre, *hoop.direction], atol=1e-2
        ):
            return i
    return len(scenario.hoops)


def _flown(flight: FewestSteps) -> tuple[NDArray[np.float32], Array, int, float]:
    return flight.actions, flight.states, flight.winding, flight.tolerance_used
