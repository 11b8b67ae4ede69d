"""A flight, and then hover at its goal: the reference of a controller that outlasts the flight.

A flight raises an error beyond its duration. A controller that arrives late still needs a reference, the goal at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Array, Quadrotor
from optimal.flights.trajectory import Flight, Samples, sample


@dataclass(frozen=True)
class HoverAtGoal:
    """A flight followed by hover at its last position; itself a flight, known at all times t >= 0.

    Attributes:
        flight: the flight, from rest to rest.
    """

    flight: Flight

    @property
    def quadrotor(self) -> Quadrotor:
        """The vehicle."""
        return self.flight.quadrotor

    @property
    def duration(self) -> float:
        """Time from start to goal [s], without the hover."""
        return self.flight.duration

    @property
    def breakpoints(self) -> Array:
        """Times between which the flight is smooth [s], shape (N+1,)."""
        return self.flight.breakpoints

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return the position [m] or its time derivative of that order, shape (..., 2); 0 in hover for order > 0."""
        within, hovering = self._split(t)
        value = self.flight(within, order)
        return np.where(hovering, 0.0, value) if order else value

    def state(self, t: ArrayLike) -> Array:
        """Return [x, z, vx, vz, theta], shape (..., 5); theta stays at its last whole turn in hover."""
        within, hovering = self._split(t)
        upright = 2 * np.pi * np.rint(self.flight.state(self.duration)[4] / (2 * np.pi))
        rest = np.concatenate([self.flight(self.duration), [0.0, 0.0, upright]])
        return np.where(hovering, rest, self.flight.state(within))

    def control(self, t: ArrayLike) -> Array:
        """Return [thrust, rate], shape (..., 2); [gravity, 0] in hover."""
        within, hovering = self._split(t)
        return np.where(hovering, [self.quadrotor.gravity, 0.0], self.flight.control(within))

    def sample(self, dt: float) -> Samples:
        """Return the flight, without the hover, at 0, dt, 2 dt, ... [s], and at its end."""
        return sample(self, dt)

    def _split(self, t: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Return times limited to the flight, shape (...), and whether they are beyond it, shape (..., 1)."""
        time = np.asarray(t, dtype=np.float64)
        if not np.isfinite(time).all():
            raise ValueError(f"times must be finite numbers of seconds, got {t!r}")
        return np.minimum(time, self.duration), np.asarray(time > self.duration)[..., None]
