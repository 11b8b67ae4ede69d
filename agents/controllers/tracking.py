"""Experts: optimal flights tracked with feedback.

    Expert(fewest_steps("hoop")).predict(observations)

Open-loop replay of the actions reaches the goal only without disturbances. The expert therefore corrects the controls
by the time-varying LQR around the flight (`agents.controllers.lqr`): u = u_k - K_k x, with x the deviation of the state
from the flight at step k. If the vehicle lags (delay, extra mass), it does not try to catch up: k is the nearest of the
last 12 points, not the current step. After the last step the expert hovers at the goal, with the LQR around hovering.
`TrackingControllers` batches many flights, each with its own LQR.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.controllers.lqr import terminal_cost, tvlqr_gains
from flatgym import task
from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from flatgym.task.observation import DecodedObservation, decode_observation
from flatgym.task.scene import Integers, Scene
from optimal.discrete.fewest_steps import FewestSteps
from optimal.flights.solution import Solution

MAX_LAG = 12
"""Points of the flight, the current one included, that `Expert` searches for the nearest."""


class Expert:
    """An optimal flight as a policy: feed-forward and time-varying LQR, with the `predict` of an SB3 model.

    Args:
        flight: the result of `optimal.fewest_steps` or `optimal.solve`. A flight in continuous time is flown in steps
            of dt with the mean controls of each step.
        max_lag: points of the flight, counted back from the current step, that are searched for the nearest. With 1
            the reference is the point of the current step, which is right for imitating a flight in K* steps.

    Raises:
        ValueError: for a result without a flight.
    """

    def __init__(self, flight: FewestSteps | Solution, max_lag: int = MAX_LAG) -> None:
        self.scenario, self._controllers = flight.scenario, TrackingControllers([flight], range(0, -max_lag, -1))

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: Any = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions (..., 2) for observations (..., 19) of the flight's scenario, and `state` unchanged."""
        seen = decode_observation(observation)
        return self.action(absolute_state(seen, self.scenario), steps_flown(seen, self.scenario)), state

    def action(self, state: Array, step: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return actions (..., 2) for states (..., 5) after `step` steps (...); the tilt counts modulo 2 pi."""
        first = np.zeros_like(step)
        point, off, _ = self._controllers.nearest(first, state, np.minimum(step, self._controllers.last[0]) - 1)
        return self._controllers.action(first, point, off)


class TrackingControllers:
    """Time-varying LQRs around n flights, evaluated as a batch.

    Args:
        flights: flights of scenarios that share vehicle, step and tolerance.
        window: points of a flight that are searched for the nearest, relative to the successor of the previous
            nearest point. With (0,) the reference advances by one point each step.

    Attributes:
        scene: the scenarios.
        last: the point of each flight from which it hovers, shape (n,).

    Raises:
        ValueError: for a result without a flight, and for different vehicles.
    """

    def __init__(self, flights: Sequence[FewestSteps | Solution], window: Sequence[int] = (0,)) -> None:
        self.window, self.scenario = np.asarray(window), flights[0].scenario
        self.scene = Scene.of([flight.scenario for flight in flights])
        flown = [in_steps(flight) for flight in flights]
        self.last = np.array([len(controls) - 1 for _, controls in flown])
        self.states, self.controls = (
            np.stack([held(one, self.last.max() + 1) for one in ones]) for ones in zip(*flown, strict=True)
        )
        self.gains = tvlqr_gains(self.scenario, self.states, self.controls, self.last)
        self._weights = np.diag(terminal_cost(self.scenario.tolerance))

    def hoops_passed(self) -> Integers:
        """Return the number of hoops each flight has passed at each of its points, shape (n, K)."""
        situation = task.initial(self.scene)
        passed = [situation.hoops_passed]
        for states, controls in zip(self.states.swapaxes(0, 1), self.controls[:, :-1].swapaxes(0, 1), strict=False):
            situation = task.advance(self.scene, replace(situation, state=states), controls)
            passed.append(situation.hoops_passed)
        return np.stack(passed, axis=1)

    def nearest(self, which: Integers, state: Array, before: Integers) -> tuple[Integers, Array, Array]:
        """Return the nearest points (...), the deviations from them (..., 5), and their norms in tolerances (...).

        Args:
            which: the index of each flight, shape (...).
            state: shape (..., 5); the tilt counts modulo 2 pi.
            before: the nearest points of the previous step, shape (...); -1 at first.
        """
        points = np.clip(before[..., None] + 1 + self.window, 0, self.last[which][..., None])
        off = state[..., None, :] - self.states[which[..., None], points]
        off[..., 4] -= 2 * np.pi * np.round(off[..., 4] / (2 * np.pi))
        far = np.square(off) @ self._weights
        best = np.argmin(far, axis=-1)[..., None]
        point, distance = (np.take_along_axis(every, best, -1)[..., 0] for every in (points, np.sqrt(far)))
        return point, np.take_along_axis(off, best[..., None], -2)[..., 0, :], distance

    def action(self, which: Integers, point: Integers, off: Array) -> NDArray[np.float32]:
        """Return actions (..., 2) of flights `which` (...) at points (...) for deviations `off` (..., 5)."""
        control = self.controls[which, point] - np.einsum("...ij,...j->...i", self.gains[which, point], off)
        return np.clip(self.scenario.quadrotor.action(control), -1, 1).astype(np.float32)


class OpenLoop:
    """Open-loop replay of a flight's actions: the baseline without feedback.

    Args:
        flight: the result of `optimal.fewest_steps` or `optimal.solve`.
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
        """Return the actions (..., 2) of the step at which observations (..., 19) were made, and `state` unchanged."""
        steps = steps_flown(decode_observation(observation), self.scenario)
        return self.actions[np.minimum(steps, len(self.actions) - 1)].astype(np.float32), state


def absolute_state(seen: DecodedObservation, scenario: Scenario) -> Array:
    """Return the states (..., 5) that observations of a scenario encode, the tilt in [-pi, pi]."""
    return np.concatenate([np.array(scenario.goal) - seen.goal, seen.velocity, seen.theta[..., None]], axis=-1)


def steps_flown(seen: DecodedObservation, scenario: Scenario) -> NDArray[np.int64]:
    """Return the environment steps (...) before observations of a scenario."""
    return np.rint(seen.time * scenario.max_steps).astype(np.int64)


def in_steps(flight: FewestSteps | Solution) -> tuple[Array, Array]:
    """Return states (K+1, 5) and controls (K+1, 2) at the environment steps of a flight; the last row hovers."""
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
        raise ValueError(f"{scenario.name!r}: the result has no flight ({flight.status.value}): {flight.reason}")
    hover = np.array([scenario.quadrotor.gravity, 0.0])
    return np.vstack([states, scenario.goal_state]), np.vstack([controls, hover])


def held(rows: Array, count: int) -> Array:
    """Return `rows` padded to `count` rows with copies of the last."""
    return np.concatenate([rows, np.repeat(rows[-1:], count - len(rows), axis=0)])
