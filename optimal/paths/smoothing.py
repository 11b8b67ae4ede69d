"""A smooth motion near a flight, as the centre line of a corridor.

The thrust of a time-optimal flight jumps, and with it the acceleration. The paths of a corridor have continuous
derivatives up to the fourth order, and cannot follow jumps. Tilt and thrust are therefore averaged over a window of
time. This changes the position, so the acceleration then receives the smallest change that restores the positions and
velocities at both ends and the positions at given instants.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from flatgym.quadrotor import Array
from optimal.flights.trajectory import Flight

SAMPLES_PER_WINDOW = 64
"""Samples of tilt and thrust within a window."""
NOWHEN = np.zeros(0)
"""No instants."""
RESTORATIONS = 3
"""Corrections of the acceleration; the first leaves the error of the quadrature."""


class SmoothMotion:
    """A motion in the plane whose acceleration is a cubic spline of time."""

    def __init__(self, times: Array, acceleration: Array, start: Array) -> None:
        """Integrate an acceleration from rest.

        Args:
            times: instants from 0 to the duration [s], shape (n,).
            acceleration: values there [m/s^2], shape (n, 2).
            start: the first position [m], shape (2,).
        """
        self.duration = float(times[-1])
        self._start = start
        self._acceleration: Any = CubicSpline(times, acceleration)

    @cached_property
    def _derivatives(self) -> tuple[Any, Any, Any]:
        velocity = self._acceleration.antiderivative()
        return velocity.antiderivative(), velocity, self._acceleration

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Return the position (order 0) [m], the velocity (1) or the acceleration (2), shape (..., 2)."""
        value = np.asarray(self._derivatives[order](t), dtype=np.float64)
        return value + self._start if order == 0 else value


def smoothed(flight: Flight, window: float, kept: Array = NOWHEN) -> SmoothMotion:
    """Return a smooth motion near a flight from rest to rest, with the same ends and duration.

    Args:
        flight: the flight.
        window: width of the average of tilt and thrust [s].
        kept: instants at which the position stays as it is [s], shape (m,).
    """
    duration = flight.duration
    count = int(np.ceil(SAMPLES_PER_WINDOW * duration / window)) + 1
    times = np.linspace(0.0, duration, count)
    tilt, thrust = flight.state(times)[:, 4], flight.control(times)[:, 0]
    tilt, thrust = (averaged(values, SAMPLES_PER_WINDOW + 1) for values in (tilt, thrust))
    # The average moves the tilt at both ends, where the flight is upright.
    for end, near in ((0, np.exp(-2 * times / window)), (-1, np.exp(-2 * (duration - times) / window))):
        tilt += (2 * np.pi * np.rint(tilt[end] / (2 * np.pi)) - tilt[end]) * near
    gravity = np.array([0.0, flight.quadrotor.gravity])
    acceleration = thrust[:, None] * np.stack([np.sin(tilt), np.cos(tilt)], axis=-1) - gravity
    return _restored(flight, times, acceleration, window, kept)


def averaged(values: Array, width: int, beyond: Literal["edge", "symmetric"] = "edge") -> Array:
    """Return the moving average of a series, shape (n,), over an odd number of values.

    Args:
        values: the series, shape (n,).
        width: the number of values.
        beyond: "edge": the series goes on with its end values; "symmetric": with its mirror image, so that the average
            has no slope at the ends.
    """
    kernel = np.hanning(width + 2)[1:-1]
    return np.convolve(np.pad(values, width // 2, mode=beyond), kernel / kernel.sum(), mode="valid")


def _restored(flight: Flight, times: Array, acceleration: Array, window: float, kept: Array) -> SmoothMotion:
    """Return the motion of the acceleration that is nearest in the mean square and meets the ends and kept positions.

    Velocity and position at the end, and the kept positions, are integrals of the acceleration times a function of
    time. The smallest change is a combination of these functions. It vanishes at both ends, where the tilt is given.
    """
    duration, start = flight.duration, flight(0.0)
    near = np.minimum(np.minimum(times, duration - times) / (2 * window), 1.0)
    share = near**2 * (3 - 2 * near)
    functions = np.stack([np.ones_like(times), duration - times, *(np.maximum(t - times, 0.0) for t in kept)], axis=1)
    gram = (functions * share[:, None]).T @ functions * (times[1] - times[0])
    ends = np.append(duration, kept)
    for _ in range(RESTORATIONS):
        motion = SmoothMotion(times, acceleration, start)
        missing = np.concatenate([-motion(duration, 1)[None], flight(ends) - motion(ends)])
        acceleration = acceleration + share[:, None] * (functions @ np.linalg.solve(gram, missing))
    return SmoothMotion(times, acceleration, start)
