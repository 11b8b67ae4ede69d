"""Disturbances: wind, errors of thrust gain and mass, action delay, sensor noise.

All are off by default. Each is sampled once an episode from its seed (`flatgym.scenarios.counter_rng`); sensor noise is
sampled at every step. Wind is a constant force, so the closed-form step remains exact. With f the commanded thrust and
m the mass relative to the nominal one,

    x'' = (gain / m) f sin(theta) + wind_x / m,   z'' = (gain / m) f cos(theta) + wind_z / m - g.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flatgym.quadrotor import Array
from flatgym.scenarios.counter_rng import DISTURBANCE, NOISE, normal, uniform
from flatgym.validation import nonnegative

DELAY_MAX = 50
"""Longest delay of an action [steps]."""


@dataclass(frozen=True)
class Disturbances:
    """Strengths of the disturbances; 0 is off.

    Attributes:
        wind: maximum acceleration of the nominal vehicle by the wind [m/s^2]; direction uniform, strength uniform in
            [0, wind].
        thrust_gain: the thrust is multiplied by a factor uniform in [1 - thrust_gain, 1 + thrust_gain].
        mass: the mass is the nominal mass times a factor uniform in [1 - mass, 1 + mass].
        action_delay: maximum delay of the actions [steps]; uniform in 0..action_delay, constant over an episode. The
            vehicle hovers before the first action acts.
        sensor_noise: standard deviation of the observed position [m], velocity [m/s] and tilt [rad].

    Raises:
        ValueError: naming the field, its value and what is allowed.
    """

    wind: float = 0.0
    thrust_gain: float = 0.0
    mass: float = 0.0
    action_delay: int = 0
    sensor_noise: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = nonnegative("Disturbances", field.name, getattr(self, field.name))
            if field.name in ("thrust_gain", "mass") and value >= 1:
                raise ValueError(f"Disturbances.{field.name} must be below 1, a share of the nominal, got {value}")
            object.__setattr__(self, field.name, value)
        if self.action_delay != int(self.action_delay) or self.action_delay > DELAY_MAX:
            raise ValueError(
                f"Disturbances.action_delay must be a whole number of steps up to {DELAY_MAX}, got {self.action_delay}"
            )
        object.__setattr__(self, "action_delay", int(self.action_delay))

    @property
    def active(self) -> dict[str, float]:
        """The disturbances that are on, by name."""
        return {name: value for name, value in asdict(self).items() if value}

    def draw(self, seed: Any, episode: Any) -> tuple[Array, Array, NDArray[np.int64]]:
        """Return thrust factors (n,), wind accelerations (n, 2) [m/s^2] and delays (n,) [steps] of n episodes.

        Args:
            seed, episode: uint64, shape (n,).
        """
        u = np.stack([uniform(seed, episode, np.uint64(DISTURBANCE + i)) for i in range(5)])
        out = np.empty((4, u.shape[1]))
        write_disturbances(u, self.wind, self.thrust_gain, self.mass, float(self.action_delay), out)
        return out[0], np.stack([out[1], out[2]], axis=-1), out[3].astype(np.int64)

    def noise(self, seed: Any, episode: Any, step: Any) -> Array:
        """Return the sensor noise of the states, shape (n, 5); arguments are uint64, shape (n,)."""
        first = np.uint64(NOISE) + step * np.uint64(10)
        errors = [normal(seed, episode, first + np.uint64(2 * i)) for i in range(5)]
        return self.sensor_noise * np.stack(errors, axis=-1)


def write_disturbances(u: Any, wind: Any, thrust_gain: Any, mass: Any, delay: Any, out: Any) -> None:
    """Write thrust factor, wind acceleration (x, z) and delay to `out` (4, ...) from uniform numbers u (5, ...)."""
    relative_mass = 1 + mass * (2 * u[0] - 1)
    out[0] = (1 + thrust_gain * (2 * u[1] - 1)) / relative_mass
    strength, angle = wind * u[2] / relative_mass, 2 * np.pi * u[3]
    out[1] = strength * np.cos(angle)
    out[2] = strength * np.sin(angle)
    out[3] = np.floor(u[4] * (delay + 1))
