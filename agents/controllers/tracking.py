"""Experts: flights known to be optimal, flown with feedback.

    Expert(fewest_steps("hoop")).predict(observations)

Feed-forward alone, the actions of the flight as they stand, ends at the goal only if nothing interferes. So the
controls are corrected by the regulator about the flight (`agents.controllers.lqr`): u = u_k - K_k x, with x the deviation
of the state from where the flight is at step k. Who is late, as by a delay or too heavy a vehicle, is not to catch up
what cannot be caught up: k is the nearest of the last steps, not the present one. After its last step the expert
hovers at the goal, with the regulator of that. `TrackingControllers` are many, each about a flight of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.controllers.lqr import regulator, terminal_cost
from flatgym import task
from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from flatgym.task.decoding import DecodedObservation, decode_observation
from flatgym.task.scene import Integers, Scene
from optimal.discrete.fewest_steps import FewestSteps
from optimal.flights.solution import Solution

LATE = 12
"""How many points of a flight back, as `Expert` has it, a vehicle may be late."""


class Expert:
    """A flight as a policy: feed-forward and a time-varying regulator, `predict` as an SB3 model has it.

    Args:
        flight: what `optimal.fewest_steps` or `optimal.solve` found; a flight in continuous time is flown in steps of
            dt by the means of its controls.
        late: points of the flight, counted back from the present step, among which the nearest is looked for; with 1
            a vehicle is to be where the flight is at this very step, as a learner of the flight in K* steps should.

    Raises:
        ValueError: for an answer without a flight.
    """

    def __init__(self, flight: FewestSteps | Solution, late: int = LATE) -> None:
        self.scenario, self._experts = flight.scenario, TrackingControllers([flight], range(0, -late, -1))

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: Any = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions (..., 2) for observations (..., 19) of its own scenario, and the state it was given."""
        seen = decode_observation(observation)
        return self.action(placed(seen, self.scenario), steps_flown(seen, self.scenario)), state

    def action(self, state: Array, step: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return actions (..., 2) for states (..., 5) after so many steps (...); whole turns do not matter."""
        first = np.zeros_like(step)
        point, off, _ = self._experts.nearest(first, state, np.minimum(step, self._experts.last[0]) - 1)
        return self._experts.action(first, point, off)


class TrackingControllers:
    """Many flights, each flown by its own regulator.

    Args:
        flights: of scenarios of one vehicle, step and tolerance.
        window: points of a flight, counted from that after the one which was nearest before, among which the nearest
            is looked for; with (0,) a vehicle is to be where its flight is at this very step.

    Attributes:
        scene: the scenarios.
        last: the point of each flight from which on it hovers, shape (n,).

    Raises:
        ValueError: for an answer without a flight, and for different vehicles.
    """

    def __init__(self, flights: Sequence[FewestSteps | Solution], window: Sequence[int] = (0,)) -> None:
        self.window, self.scenario = np.asarray(window), flights[0].scenario
        self.scene = Scene.of([flight.scenario for flight in flights])
        flown = [in_steps(flight) for flight in flights]
        self.last = np.array([len(controls) - 1 for _, controls in flown])
        self.states, self.controls = (
            np.stack([held(one, self.last.max() + 1) for one in ones]) for ones in zip(*flown, strict=True)
        )
        self.gains = regulator(self.scenario, self.states, self.controls, self.last)
        self._weights = np.diag(terminal_cost(self.scenario.tolerance))

    def hoops_passed(self) -> Integers:
        """Return how many hoops each flight has passed at each of its points, shape (n, K)."""
        situation = task.initial(self.scene)
        passed = [situation.hoops_passed]
        for states, controls in zip(self.states.swapaxes(0, 1), self.controls[:, :-1].swapaxes(0, 1), strict=False):
            situation = task.advance(self.scene, replace(situation, state=states), controls)
            passed.append(situation.hoops_passed)
        return np.stack(passed, axis=1)

    def nearest(self, which: Integers, state: Array, before: Integers) -> tuple[Integers, Array, Array]:
        """Return the nearest points (...) of flights, how far off them states are (..., 5), and in tolerances (...).

        Args:
            which: the flights, shape (...).
            state: shape (..., 5); whole turns do not matter.
            before: the points that were nearest a step before, shape (...); -1 at first.
        """
        points = np.clip(before[..., None] + 1 + self.window, 0, self.last[which][..., None])
        off = state[..., None, :] - self.states[which[..., None], points]
        off[..., 4] -= 2 * np.pi * np.round(off[..., 4] / (2 * np.pi))
        far = np.square(off) @ self._weights
        best = np.argmin(far, axis=-1)[..., None]
        point, distance = (np.take_along_axis(every, best, -1)[..., 0] for every in (points, np.sqrt(far)))
        return point, np.take_along_axis(off, best[..., None], -2)[..., 0, :], distance

    def action(self, which: Integers, point: Integers, off: Array) -> NDArray[np.float32]:
        """Return actions (..., 2) of flights (...) at points (...), states being so far off (..., 5)."""
        control = self.controls[which, point] - np.einsum("...ij,...j->...i", self.gains[which, point], off)
        return np.clip(self.scenario.quadrotor.action(control), -1, 1).astype(np.float32)


class OpenLoop:
    """A flight's actions played as they stand, whatever is seen: what feedback has to beat.

    Args:
        flight: what `optimal.fewest_steps` or `optimal.solve` found.
    """

    def __init__(self, flight: FewestSteps | Solution) -> None:
        self.scenario, self.actions = flight.scenario, flight.scenario.quadrotor.action(in_steps(flight)[1])

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: Any = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the actions (..., 2) of the step that observations (..., 19) are of, and the state it was given."""
        steps = steps_flown(decode_observation(observation), self.scenario)
        return self.actions[np.minimum(steps, len(self.actions) - 1)].astype(np.float32), state


def placed(seen: DecodedObservation, scenario: Scenario) -> Array:
    """Return the states (..., 5) that a scenario's observations tell of, the tilt in [-pi, pi]."""
    return np.concatenate([np.array(scenario.goal) - seen.goal, seen.velocity, seen.theta[..., None]], axis=-1)


def steps_flown(seen: DecodedObservation, scenario: Scenario) -> NDArray[np.int64]:
    """Return after how many steps (...) a scenario's observations were made."""
    return np.rint(seen.time * scenario.max_steps).astype(np.int64)


def in_steps(flight: FewestSteps | Solution) -> tuple[Array, Array]:
    """Return states and controls of a flight in environment steps, and of hovering behind it, (K+1, 5) and (K+1, 2)."""
    scenario = flight.scenario
    if isinstance(flight, FewestSteps):
        states, controls = flight.states[:-1], scenario.quadrotor.control(flight.actions)
    elif flight.trajectory is not None:
        way = flight.trajectory.sample(scenario.dt)
        states = way.state[:-1]
        thirds = (np.arange(len(states))[:, None] + np.arange(1, 6, 2) / 6) * scenario.dt
        controls = flight.trajectory.control(np.minimum(thirds, flight.trajectory.duration)).mean(axis=1)
    else:
        states = controls = np.zeros((0, 0))
    if not len(states):
        raise ValueError(f"{scenario.name!r}: the answer holds no flight ({flight.status.value}): {flight.reason}")
    hover = np.array([scenario.quadrotor.gravity, 0.0])
    return np.vstack([states, scenario.goal_state]), np.vstack([controls, hover])


def held(rows: Array, count: int) -> Array:
    """Return `count` rows, the last of them again and again."""
    return np.concatenate([rows, np.repeat(rows[-1:], count - len(rows), axis=0)])
