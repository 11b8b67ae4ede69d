"""Trajectories: the protocol of every method, and the trajectory of controls held between breakpoints.

    trajectory(t, order)    position and its time derivatives, the paper's flat output y = (x, z)
    trajectory.state(t), trajectory.control(t), trajectory.sample(dt)

Under held controls every arc is the closed form of `flatgym.Quadrotor.step`. Such a trajectory is known at every
instant, not only at its breakpoints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from flatgym.quadrotor import Array, Quadrotor


@dataclass(frozen=True)
class Samples:
    """A trajectory at n instants.

    Attributes:
        time: the instants [s], shape (n,).
        state: the states at them, shape (n, 5).
        control: the controls at them, shape (n, 2).
        held: True: each control is held to the next instant, which flies exactly from state to state. False: the
            control changes between the instants; the samples are a reference to track, and held they miss the goal.
    """

    time: Array
    state: Array
    control: Array
    held: bool = False


class Flight(Protocol):
    """The trajectory of any method; times are in [0, duration] and have any shape (...)."""

    @property
    def quadrotor(self) -> Quadrotor:
        """The vehicle."""

    @property
    def duration(self) -> float:
        """Time from start to goal [s]."""

    @property
    def breakpoints(self) -> Array:
        """Times between which the flight is smooth [s], increasing from 0 to the duration, shape (N+1,)."""

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return the position (order 0) or its time derivative of that order, shape (..., 2)."""

    def state(self, t: ArrayLike) -> Array:
        """Return [x, z, vx, vz, theta], shape (..., 5)."""

    def control(self, t: ArrayLike) -> Array:
        """Return [thrust, rate], shape (..., 2)."""

    def sample(self, dt: float) -> Samples:
        """Return the flight at 0, dt, 2 dt, ... [s], and at its end."""


def sample(flight: Flight, dt: float) -> Samples:
    """Return the flight at 0, dt, 2 dt, ..., and at its end.

    Raises:
        ValueError: when dt is not a positive number.
    """
    if not (np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt must be a positive number of seconds, got {dt!r}")
    count = int(np.ceil(flight.duration / dt - 1e-9))
    time = np.append(np.arange(count) * dt, flight.duration)
    return Samples(time, flight.state(time), flight.control(time))


@dataclass(frozen=True)
class Trajectory:
    """Piecewise constant controls and the exact flight under these controls.

    Attributes:
        breakpoints: times at which the control changes [s], shape (N+1,).
        states: states at the breakpoints, shape (N+1, 5).
        controls: controls held from each breakpoint to the next, shape (N, 2).
        quadrotor: the vehicle.
    """

    breakpoints: Array
    states: Array
    controls: Array
    quadrotor: Quadrotor

    @property
    def duration(self) -> float:
        """Time from start to goal [s]."""
        return float(self.breakpoints[-1])

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return the position [m] or its time derivative of that order, shape (..., 2).

        Args:
            t: times in [0, duration] [s], shape (...).
            order: 0 position, 1 velocity, 2 acceleration, 3 jerk; at a breakpoint the last two are those of the arc
                that begins there.

        Raises:
            ValueError: for another order, or times outside the flight.
        """
        if order not in range(4):
            raise ValueError(f"order must be 0, 1, 2 or 3, got {order!r}")
        state, control = self.state(t), self.control(t)
        if order < 2:
            return state[..., 2 * order : 2 * order + 2]
        if order == 2:
            return self.quadrotor.derivative(state, control)[..., 2:4]
        turning = np.stack([np.cos(state[..., 4]), -np.sin(state[..., 4])], axis=-1)
        return (control[..., 0] * control[..., 1])[..., None] * turning

    def state(self, t: ArrayLike) -> Array:
        """Return [x, z, vx, vz, theta] at times t, shape (..., 5)."""
        time, arc = self._arc(t)
        return self.quadrotor.step(self.states[arc], self.controls[arc], time - self.breakpoints[arc])

    def control(self, t: ArrayLike) -> Array:
        """Return [thrust, rate] at times t, shape (..., 2)."""
        return self.controls[self._arc(t)[1]]

    def sample(self, dt: float) -> Samples:
        """Return the flight at 0, dt, 2 dt, ..., and at its end."""
        return sample(self, dt)

    def held(self) -> Samples:
        """Return the flight at its breakpoints, with the controls to hold between them; the last is repeated."""
        return Samples(self.breakpoints, self.states, np.append(self.controls, self.controls[-1:], axis=0), held=True)

    def _arc(self, t: ArrayLike) -> tuple[Array, np.ndarray[tuple[int, ...], np.dtype[np.int64]]]:
        time = np.asarray(t, dtype=np.float64)
        slack = 1e-9 * max(1.0, self.duration)
        if not np.all((time >= -slack) & (time <= self.duration + slack)):
            raise ValueError(f"times must lie in [0, {self.duration}] s, got {np.min(time)} to {np.max(time)}")
        arc = np.searchsorted(self.breakpoints, time, side="right") - 1
        return time, np.clip(arc, 0, len(self.controls) - 1)
