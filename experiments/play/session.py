"""A session of manual flight: keys and sticks become actions, commands change the session. It draws nothing.

An optimal flight lasts 1.4 s, so it is shown in slow motion. Time advances by fractions of an environment step; within
a step the exact arc is shown. An action is read at the start of a step and held for the whole step, as for any agent.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.evaluation.optima import best_known
from experiments.files import cache_folder
from flatgym.quadrotor import Array
from flatgym.rendering.instant import Instant
from flatgym.scenarios import catalogue
from flatgym.scenarios.reference import Reference
from flatgym.scenarios.scenario import Scenario
from flatgym.task.rollout import open_loop_states

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
"""Directions of held keys, by name of the key."""
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
"""Commands of pressed keys, by name of the key."""
RATE_AXIS, LIFT_AXIS, TRIGGER_AXIS = 0, 3, 5
"""Axes of a gamepad, in [-1, 1]: left stick to the right, right stick downwards, right trigger."""
DEAD_ZONE = 0.12
"""Share of a stick's travel that counts as released."""
SPEED_MIN, SPEED_MAX = 0.05, 2.0
"""Limits of the speed of time; 1 is real time."""
COUNTDOWN = 3.0
"""Time until the flight begins if no control is touched [s]."""


@dataclass
class Controls:
    """The state of the controls: names of the held keys, and values of the gamepad axes by number."""

    held: set[str] = field(default_factory=set)
    axes: dict[int, float] = field(default_factory=dict)

    @property
    def touched(self) -> bool:
        """Whether a key is held or a stick is outside its dead zone."""
        return bool(self.held) or any(abs(value) > DEAD_ZONE for value in self.axes.values())

    def action(self, hover: float) -> NDArray[np.float32]:
        """Return thrust and rate in [-1, 1], shape (2,); `hover` is the thrust without input."""
        keys, sticks = key_action(self.held, hover), stick_action(self.axes, hover)
        return np.where(sticks == (hover, 0.0), keys, sticks).astype(np.float32)


def key_action(held: Iterable[str], hover: float) -> Array:
    """Return the action of held keys, shape (2,): at the limits, and opposite keys cancel."""
    directions = {STEERING[name] for name in held if name in STEERING}
    lift = ("up" in directions) - ("down" in directions)
    rate = ("right" in directions) - ("left" in directions)
    return np.array([float(lift) if lift else hover, float(rate)])


def stick_action(axes: dict[int, float], hover: float) -> Array:
    """Return a gamepad's action, shape (2,): the stick spans both thrust limits, the trigger those above hover."""
    lift, pulled = -deflection_of(axes.get(LIFT_AXIS, 0.0)), max(deflection_of(axes.get(TRIGGER_AXIS, 0.0)), 0.0)
    lift = lift if lift else pulled
    thrust = hover + (1 - hover) * lift if lift > 0 else hover + (hover + 1) * lift
    return np.array([thrust, deflection_of(axes.get(RATE_AXIS, 0.0))])


def deflection_of(value: float) -> float:
    """Return the deflection of a stick beyond its dead zone, in [-1, 1]."""
    deflection = (min(abs(value), 1.0) - DEAD_ZONE) / (1 - DEAD_ZONE)
    return float(np.copysign(deflection, value)) if deflection > 0 else 0.0


class Session:
    """Manual flights, one after the other.

    Args:
        problem: name or file of a scenario or distribution; a distribution gives a new scenario for each flight.
        speed: speed of time; 1 is real time.
        ghost: whether to show the best-known flight.
    """

    def __init__(self, problem: str, speed: float = 0.25, ghost: bool = True) -> None:
        if not SPEED_MIN <= speed <= SPEED_MAX:
            raise ValueError(f"speed must lie in {SPEED_MIN}..{SPEED_MAX}, got {speed}")
        task = catalogue.problem(problem)
        self.env = gym.make("FlatQuad-v0", scenario=task, reward="sparse", observation="state")
        self._best = best_known(task, cache_folder()) if isinstance(task, Scenario) else None
        self.speed, self.show_ghost = speed, ghost
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
        """The best-known solution of the scenario; None for the samples of a distribution."""
        return self._best

    @property
    def ghost(self) -> Array | None:
        """States of the best-known flight, shape (K*+1, 5)."""
        return None if self._best is None else open_loop_states(self.scenario, self._best.actions)

    @property
    def hover(self) -> float:
        """The thrust, in [-1, 1], that balances gravity."""
        quadrotor = self.scenario.quadrotor
        return float(quadrotor.action([quadrotor.gravity, 0.0])[0])

    def restart(self) -> None:
        """Reset to the start, or to the next scenario; the flight waits for the controls or the countdown."""
        _, self._info = self.env.reset(seed=0 if self.flights == 0 else None)
        self._states: list[Array] = [self._info["state"]]
        self._thrusts: list[float] = []
        self._rate, self._fraction, self._passed = 0.0, 1.0, self._info["hoops_passed"]
        self.countdown, self.paused = COUNTDOWN, False
        self.flights += 1

    def command(self, name: str) -> None:
        """Execute one of the values of COMMANDS; other words do nothing."""
        if name == "restart":
            self.restart()
        elif name == "pause":
            self.paused = not self.paused and self.outcome == "flying"
        elif name == "ghost":
            self.show_ghost = not self.show_ghost
        elif name in ("slower", "faster"):
            factor = 0.8 if name == "slower" else 1.25
            self.speed = float(np.clip(self.speed * factor, SPEED_MIN, SPEED_MAX))
        elif name == "quit":
            self.over = True

    def advance(self, controls: Controls, seconds: float) -> None:
        """Advance by `seconds` of the user's time."""
        if self.countdown > 0:
            self.countdown = 0.0 if controls.touched else self.countdown - seconds
            return
        if self.paused:
            return
        parts = seconds * self.speed / self.scenario.dt
        while parts > 0 and self.outcome == "flying":
            if self._fraction >= 1:
                self._step(controls.action(self.hover))
            flown = min(parts, 1 - self._fraction)
            self._fraction, parts = self._fraction + flown, parts - flown
            if self._fraction > 1 - 1e-9:
                self._arrive()

    @property
    def outcome(self) -> str:
        """The outcome at the time shown."""
        return str(self._info["outcome"]) if self._fraction >= 1 else "flying"

    @property
    def steps(self) -> int:
        """Steps that have begun."""
        return len(self._thrusts)

    @property
    def instant(self) -> Instant:
        """The situation at the time shown."""
        states = np.array(self._states)
        if self._fraction < 1:
            control = [self._thrusts[-1], self._rate]
            arc = self.scenario.quadrotor.step(states[-2], control, self._fraction * self.scenario.dt)
            states = np.concatenate([states[:-1], arc[None]])
        return Instant(states, np.array(self._thrusts), self._passed, self.outcome, self._fraction)

    def result_text(self) -> str:
        """Return the result of an ended flight in words."""
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
        self._fraction = 0.0

    def _arrive(self) -> None:
        self._fraction, self._passed = 1.0, self._info["hoops_passed"]
        if self._info["is_success"] and (self.best_steps == 0 or self.steps < self.best_steps):
            self.best_steps = self.steps
