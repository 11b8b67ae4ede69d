"""Experts: a flight known to be optimal, flown with feedback.

    Expert(fewest_steps("hoop")).predict(observations)

Feed-forward alone, the actions of the flight as they stand, ends at the goal only if nothing interferes. So the
controls are corrected by a time-varying linear-quadratic regulator about the flight (Anderson and Moore 1990): with
x the deviation of the state from where the flight is at step k,

    u = u_k - K_k x,   K_k = (R + B' P B)^-1 B' P A,   P_k = Q + A' P A - A' P B K_k,

A and B the derivatives of the exact step there, and P at the end such that a deviation as large as the tolerance
costs 1. Who is late, as by a delay or too heavy a vehicle, is not to catch up what cannot be caught up: k is the
nearest of the last steps, not the present one. After its last step the expert hovers at the goal, with the regulator
of that.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_discrete_are

from agents.seen import Seen, relative_state
from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenario import Scenario, Tolerance
from optimal.solution import Solution
from optimal.steps import FewestSteps

PUSH = 1e-6
"""Half the difference of states and controls from which derivatives are taken."""
EFFORT = 1.0
"""What a correction as large as half the control's range costs, where one of the state as large as the tolerance
costs 1 at the end."""
DRIFT = 0.002
"""What such a deviation costs at each step on the way."""
LATE = 12
"""How many points of a flight back, as `Expert` has it, a vehicle may be late."""
HELD = 10.0
"""Factor on the cost of correcting a control that stands at its limit: it can move one way only."""


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
        self.late, self.scenario = late, flight.scenario
        self.states, self.controls = in_steps(flight)
        self.gains = regulator(self.scenario, self.states, self.controls)
        self._weights = np.diag(terminal_cost(self.scenario.tolerance))

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: Any = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions (..., 2) for observations (..., 19) of its own scenario, and the state it was given."""
        seen = relative_state(observation)
        return self.action(placed(seen, self.scenario), steps_flown(seen, self.scenario)), state

    def action(self, state: Array, step: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return actions (..., 2) for states (..., 5) after so many steps (...); whole turns do not matter."""
        k, off = self._nearest(state, step)
        control = self.controls[k] - np.einsum("...ij,...j->...i", self.gains[k], off)
        return np.clip(self.scenario.quadrotor.action(control), -1, 1).astype(np.float32)

    def distance(self, state: Array, step: NDArray[np.int64]) -> Array:
        """Return how far states (..., 5) after so many steps (...) are from the flight, in tolerances, shape (...)."""
        return np.asarray(np.sqrt(np.square(self._nearest(state, step)[1]) @ self._weights))

    def _nearest(self, state: Array, step: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
        """Return which of the last points of the flight is nearest, and how far from it the states are."""
        last = np.minimum(step, len(self.controls) - 1)
        points = np.maximum(last[..., None] - np.arange(self.late), 0)
        off = state[..., None, :] - self.states[points]
        off[..., 4] -= 2 * np.pi * np.round(off[..., 4] / (2 * np.pi))
        best = np.argmin(np.square(off) @ self._weights, axis=-1)[..., None]
        return np.take_along_axis(points, best, -1)[..., 0], np.take_along_axis(off, best[..., None], -2)[..., 0, :]


class Tape:
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
        steps = steps_flown(relative_state(observation), self.scenario)
        return self.actions[np.minimum(steps, len(self.actions) - 1)].astype(np.float32), state


def placed(seen: Seen, scenario: Scenario) -> Array:
    """Return the states (..., 5) that a scenario's observations tell of, the tilt in [-pi, pi]."""
    return np.concatenate([np.array(scenario.goal) - seen.goal, seen.velocity, seen.theta[..., None]], axis=-1)


def steps_flown(seen: Seen, scenario: Scenario) -> NDArray[np.int64]:
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


def regulator(scenario: Scenario, states: Array, controls: Array) -> Array:
    """Return the gains of the regulator about states (n, 5) and controls (n, 2), shape (n, 2, 5); the last for ever."""
    quadrotor, dt = scenario.quadrotor, scenario.dt
    a, b = derivatives(quadrotor, states, controls, dt)
    arrived = terminal_cost(scenario.tolerance)
    half = (quadrotor.control_high - quadrotor.control_low) / 2
    cheap = np.diag(EFFORT / half**2)
    gains = np.zeros((len(states), 2, 5))
    forever = solve_discrete_are(a[-1], b[-1], DRIFT * arrived, cheap)
    gains[-1] = gain(a[-1], b[-1], cheap, forever)
    cost = arrived
    for k in range(len(states) - 2, -1, -1):
        held = np.abs(quadrotor.action(controls[k])) > 1 - 1e-6
        effort = cheap * np.diag(np.where(held, HELD, 1.0))
        gains[k] = gain(a[k], b[k], effort, cost)
        cost = DRIFT * arrived + a[k].T @ cost @ (a[k] - b[k] @ gains[k])
    return gains


def gain(a: Array, b: Array, effort: Array, cost: Array) -> Array:
    """Return the gain of one step, shape (2, 5)."""
    return np.asarray(np.linalg.solve(effort + b.T @ cost @ b, b.T @ cost @ a))


def terminal_cost(tolerance: Tolerance) -> Array:
    """Return the cost of a deviation at the goal, 1 at each tolerance, shape (5, 5)."""
    return np.diag(1.0 / np.square(tolerances(tolerance)))


def tolerances(tolerance: Tolerance) -> Array:
    """Return the tolerance of each component of a state, shape (5,)."""
    return np.array([tolerance.position] * 2 + [tolerance.speed] * 2 + [tolerance.angle])


def derivatives(quadrotor: Quadrotor, states: Array, controls: Array, dt: float) -> tuple[Array, Array]:
    """Return the derivatives of the step by state and by control, shapes (n, 5, 5) and (n, 5, 2)."""
    push = PUSH * np.eye(7)[:, None]
    up, down = (quadrotor.step(states + s * push[..., :5], controls + s * push[..., 5:], dt) for s in (1, -1))
    both = np.moveaxis((up - down) / (2 * PUSH), 0, -1)
    return both[..., :5], both[..., 5:]
