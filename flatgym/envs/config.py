"""The configuration of an environment as one frozen value, and the pool of start states for training."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flatgym.quadrotor import Array, Quadrotor
from flatgym.scenarios.catalogue import Problem
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.scenario import STEPS_MOST, Scenario, Tolerance
from flatgym.task.observation import observation_names
from flatgym.task.scene import Integers
from flatgym.validation import number, numbers, whole

REWARDS = ("shaped", "sparse")
STATE_MOST = 1e4
"""Largest magnitude of a component of a start state [m, m/s, rad]."""


@dataclass(frozen=True, eq=False)
class Starts:
    """A pool of start states for training; each episode samples one of its rows, as a function of its seed.

    Attributes:
        state: [x, z, vx, vz, theta], shape (m, 5).
        hoops_passed: hoops that count as passed at the start, shape (m,); none by default.
        share: probability that an episode starts in the pool; otherwise it starts at the scenario's start.

    Raises:
        ValueError: naming the field, its value and what is allowed.
    """

    state: Array
    hoops_passed: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    share: float = 1.0

    def __post_init__(self) -> None:
        state = numbers("Starts.state", self.state)
        if state.ndim != 2 or not len(state):
            raise ValueError(f"Starts.state must have shape (m, 5) with m >= 1, got {state.shape}")
        object.__setattr__(self, "state", check_states(state, state.shape[:1], "Starts.state"))
        passed = numbers("Starts.hoops_passed", self.hoops_passed)
        passed = passed if passed.size else np.zeros(len(state))
        if passed.shape != (len(state),) or np.any(passed != np.floor(passed)) or np.any((passed < 0) | (passed > 1e6)):
            raise ValueError(f"Starts.hoops_passed must be whole numbers >= 0 of shape ({len(state)},), got {passed}")
        object.__setattr__(self, "hoops_passed", passed.astype(np.int64))
        if not 0 <= number("Starts", "share", self.share) <= 1:
            raise ValueError(f"Starts.share must lie in [0, 1], got {self.share}")

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as lists and numbers, ready for JSON; `Starts(**fields)` is the inverse."""
        return {"state": self.state.tolist(), "hoops_passed": self.hoops_passed.tolist(), "share": float(self.share)}


def check_states(state: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Return states of shape (*shape, 5) as float64; a ValueError for another shape, and beyond STATE_MOST."""
    values = numbers(name, state).astype(np.float64)
    if values.shape != (*shape, 5) or not np.all(np.abs(values) <= STATE_MOST):
        each = " for each vehicle" if shape else ""
        raise ValueError(
            f"{name} must be five finite numbers [x, z, vx, vz, theta]{each}, within {STATE_MOST:g} of zero, "
            f"got {state!r}"
        )
    return values


@dataclass(frozen=True)
class EnvConfig:
    """Configuration of an environment.

    Attributes:
        problem: the scenario, or the distribution from which each episode's scenario is sampled.
        reward: "shaped" or "sparse".
        observation: "features" or "state".
        disturbances: wind, thrust and mass errors, delay, sensor noise.
        starts: pool of start states, or its `to_dict`; only with a scenario, not with a distribution.
        steps_most: truncate after this many steps if that is earlier than the problem's time limit.
        margin: tolerance, gaps and heights are wider by this [m, m/s, rad], tighter if negative. A replay with a small
            margin shows whether a flight depends on rounding.

    Raises:
        ValueError: naming the argument, its value and what is allowed.
    """

    problem: Problem
    reward: str = "shaped"
    observation: str = "features"
    disturbances: Disturbances = field(default_factory=Disturbances)
    starts: Starts | None = None
    steps_most: int | None = None
    margin: float = 0.0

    def __post_init__(self) -> None:
        observation_names(self.observation)
        if not isinstance(self.reward, str) or self.reward not in REWARDS:
            raise ValueError(f"unknown reward {self.reward!r}; known: {', '.join(REWARDS)}")
        if self.steps_most is not None:
            whole("max_episode_steps", self.steps_most, 1, STEPS_MOST)
        if isinstance(self.starts, dict):
            object.__setattr__(self, "starts", _starts(self.starts))
        if self.starts is None:
            return
        if not isinstance(self.starts, Starts):
            raise ValueError(f"starts must be a flatgym.envs.config.Starts or None, got {self.starts!r}")
        if not isinstance(self.problem, Scenario):
            raise ValueError(f"starts belong to a scenario, not to the distribution {self.problem.name!r}")
        most, allowed = int(self.starts.hoops_passed.max()), len(self.problem.hoops)
        if most > allowed:
            raise ValueError(f"Starts.hoops_passed must not exceed the {allowed} hoops of the scenario, got {most}")

    @property
    def shaped(self) -> bool:
        """Whether the reward is shaped."""
        return self.reward == "shaped"

    @property
    def quadrotor(self) -> Quadrotor:
        """The vehicle."""
        return self.problem.quadrotor

    @property
    def tolerance(self) -> Tolerance:
        """The goal tolerance, with the margin; a negative margin takes at most half of it."""
        near = self.problem.tolerance
        if not self.margin:
            return near
        position, speed, angle = (max(value + self.margin, value / 2) for value in astuple(near))
        return Tolerance(position, speed, min(angle, math.pi))

    @property
    def dt(self) -> float:
        """Length of a step [s]."""
        return self.problem.dt

    @property
    def last_step(self) -> int:
        """Steps after which an episode is truncated; reward and observed time depend on the time limit only."""
        return min(self.steps_most or STEPS_MOST, self.problem.max_steps)

    @property
    def hoops_most(self) -> int:
        """Maximum number of hoops of an episode."""
        return len(self.problem.hoops) if isinstance(self.problem, Scenario) else self.problem.hoops[1]


def _starts(fields: dict[str, Any]) -> Starts:
    """Return the pool of a `to_dict`."""
    try:
        return Starts(**fields)
    except TypeError as error:
        raise ValueError(f"not a pool of starts: {error}") from None
