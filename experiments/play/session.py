"""A person at the controls: keys and sticks become actions, commands change the session; nothing here draws.

The flight is seen in slow motion, since an optimal one lasts 1.4 s: time advances by parts of a step, and what is seen
within a step is the exact arc. An action is taken as a step begins and held for the whole step, as for any agent.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.rendering.instant import Instant
from flatgym.scenarios import catalogue
from flatgym.scenarios.reference import Reference, ghost_states, reference
from flatgym.scenarios.scenario import Scenario

STEERING = {
    "left": "left",
    "right": "right",
    "up": "up",
    "down": "down",
    "a": "left",
    "d": "right",
    "w": "up",
    "s": "down",
}
"""What keys do while they are held, by the name of the key."""
COMMANDS = {
    "r": "restart",
    "return": "restart",
    "space": "pause",
    "g": "ghost",
    "[": "slower",
    "-": "slower",
    "]": "faster",
    "=": "faster",
    "+": "faster",
    "q": "quit",
    "escape": "quit",
}
"""What keys do once when they are pressed."""
RATE_AXIS, LIFT_AXIS, TRIGGER_AXIS = 0, 3, 5
"""Axes of a gamepad: left stick to the right, right stick downwards, right trigger; values in [-1, 1]."""
DEAD_ZONE = 0.12
"""Share of a stick's way that counts as rest."""
SPEED_LEAST, SPEED_MOST = 0.05, 2.0
PATIENCE = 3.0
"""The flight begins with the first touch of the controls, or after this long [s]."""


@dataclass
class Controls:
    """What is held: keys by their names, axes of a gamepad by their numbers."""

    held: set[str] = field(default_factory=set)
    axes: dict[int, float] = field(default_factory=dict)

    @property
    def touched(self) -> bool:
        """Whether anything is held."""
        return bool(self.held) or any(abs(value) > DEAD_ZONE for value in self.axes.values())

    def action(self, hover: float) -> NDArray[np.float32]:
        """Return thrust and rate in [-1, 1], shape (2,); `hover` is the thrust when nothing is held."""
        keys, sticks = key_action(self.held, hover), stick_action(self.axes, hover)
        return np.where(sticks == (hover, 0.0), keys, sticks).astype(np.float32)


def key_action(held: Iterable[str], hover: float) -> Array:
    """Return the action of held keys, shape (2,): all or nothing, and opposite keys cancel."""
    ways = {STEERING[name] for name in held if name in STEERING}
    lift, rate = (("up" in ways) - ("down" in ways)), (("right" in ways) - ("left" in ways))
    return np.array([float(lift) if lift else hover, float(rate)])


def stick_action(axes: dict[int, float], hover: float) -> Array:
    """Return the action of a gamepad, shape (2,): from hover the stick reaches both limits, the trigger the upper."""
    lift, pulled = -beyond(axes.get(LIFT_AXIS, 0.0)), max(beyond(axes.get(TRIGGER_AXIS, 0.0)), 0.0)
    lift = lift if lift else pulled
    thrust = hover + (1 - hover) * lift if lift > 0 else hover + (hover + 1) * lift
    return np.array([thrust, beyond(axes.get(RATE_AXIS, 0.0))])


def beyond(value: float) -> float:
    """Return how far a stick is beyond its dead zone, in [-1, 1]."""
    way = (min(abs(value), 1.0) - DEAD_ZONE) / (1 - DEAD_ZONE)
    return float(np.copysign(way, value)) if way > 0 else 0.0


class Session:
    """Flights of a person, one after the other.

    Args:
        problem: what is flown, a name; a distribution gives another scenario each flight.
        speed: of the time that is seen; 1 is real time.
        ghost: whether the best flight known is drawn beside.
    """

    def __init__(self, problem: str, speed: float = 0.25, ghost: bool = True) -> None:
        if not SPEED_LEAST <= speed <= SPEED_MOST:
            raise ValueError(f"speed must lie in {SPEED_LEAST}..{SPEED_MOST}, got {speed}")
        self.env = gym.make("FlatQuad-v0", scenario=catalogue.problem(problem), reward="sparse", observation="state")
        self.speed, self.with_ghost = speed, ghost
        self.paused, self.over = False, False
        self.flights, self.best_steps = 0, 0
        self.restart()

    @property
    def scenario(self) -> Scenario:
        """The scenario of the present flight."""
        scenario: Scenario = self.env.unwrapped.scenario  # type: ignore[attr-defined]
        return scenario

    @property
    def reference(self) -> Reference | None:
        """What is known of it."""
        return reference(self.scenario)

    @property
    def ghost(self) -> Array | None:
        """The best flight known of it, shape (K*+1, 5)."""
        return None if self.reference is None else ghost_states(self.scenario)

    @property
    def hover(self) -> float:
        """The action whose thrust is the vehicle's weight."""
        quadrotor = self.scenario.quadrotor
        return float(quadrotor.action([quadrotor.gravity, 0.0])[0])

    def restart(self) -> None:
        """Go back to the start, or on to the next scenario; the flight waits for the first touch of the controls."""
        _, self._info = self.env.reset(seed=0 if self.flights == 0 else None)
        self._states: list[Array] = [self._info["state"]]
        self._thrusts: list[float] = []
        self._rate, self._part, self._passed = 0.0, 1.0, self._info["hoops_passed"]
        self.waiting, self.paused = PATIENCE, False
        self.flights += 1

    def command(self, word: str) -> None:
        """Obey one of the words in COMMANDS."""
        if word == "restart":
            self.restart()
        elif word == "pause":
            self.paused = not self.paused and self.outcome == "flying"
        elif word == "ghost":
            self.with_ghost = not self.with_ghost
        elif word in ("slower", "faster"):
            factor = 0.8 if word == "slower" else 1.25
            self.speed = float(np.clip(self.speed * factor, SPEED_LEAST, SPEED_MOST))
        elif word == "quit":
            self.over = True

    def advance(self, controls: Controls, seconds: float) -> None:
        """Let so many seconds pass in front of the screen."""
        if self.waiting > 0:
            self.waiting = 0.0 if controls.touched else self.waiting - seconds
            return
        if self.paused:
            return
        parts = seconds * self.speed / self.scenario.dt
        while parts > 0 and self.outcome == "flying":
            if self._part >= 1:
                self._step(controls.action(self.hover))
            flown = min(parts, 1 - self._part)
            self._part, parts = self._part + flown, parts - flown
            if self._part > 1 - 1e-9:
                self._arrive()

    @property
    def outcome(self) -> str:
        """How the flight stands, as far as it is seen."""
        return str(self._info["outcome"]) if self._part >= 1 else "flying"

    @property
    def steps(self) -> int:
        """Steps begun."""
        return len(self._thrusts)

    @property
    def instant(self) -> Instant:
        """What is seen."""
        states = np.array(self._states)
        if self._part < 1:
            control = [self._thrusts[-1], self._rate]
            arc = self.scenario.quadrotor.step(states[-2], control, self._part * self.scenario.dt)
            states = np.concatenate([states[:-1], arc[None]])
        return Instant(states, np.array(self._thrusts), self._passed, self.outcome, self._part)

    def verdict(self) -> str:
        """Return the result of a flight that has ended, in words."""
        if self.outcome != "goal":
            return f"{self.outcome} after {self.steps} steps"
        known = self.reference
        score = f"; K* is {known.k_star}, the gap {known.gap(self.steps):+.1%}" if known else ""
        return f"goal in {self.steps} steps{score}"

    def _step(self, action: NDArray[np.float32]) -> None:
        *_, self._info = self.env.step(action)
        thrust, self._rate = (float(value) for value in self.scenario.quadrotor.control(action))
        self._states.append(self._info["state"])
        self._thrusts.append(thrust)
        self._part = 0.0

    def _arrive(self) -> None:
        self._part, self._passed = 1.0, self._info["hoops_passed"]
        if self._info["is_success"] and (self.best_steps == 0 or self.steps < self.best_steps):
            self.best_steps = self.steps
