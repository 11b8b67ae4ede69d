"""The planar quadrotor and its exact step, paper eqs. (3)-(5).

    x'' = f sin(theta),   z'' = f cos(theta) - g,   theta' = omega,
    thrust_min <= f <= thrust_max,   |omega| <= rate_max.

State [x, z, vx, vz, theta], control [thrust, rate] = [f, omega]; metres, seconds, radians.

Under a constant control the equations have a closed-form solution, so simulation has no integration error. With h the
step, a = omega h / 2 half the rotation, m = theta + a the mean tilt, and j0, j1 the spherical Bessel functions,

    vx(h) = vx + f h j0(a) sin m
    vz(h) = vz + f h j0(a) cos m - g h
    x(h)  = x + vx h + (f h^2 / 2) (j0(a) sin m - j1(a) cos m)
    z(h)  = z + vz h + (f h^2 / 2) (j0(a) cos m + j1(a) sin m) - g h^2 / 2
    theta(h) = theta + omega h.

Nothing divides by omega: j0 and j1 are power series in a^2 about zero.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flatgym.arrays import as_array, like, namespace
from flatgym.validation import nonnegative

Array = NDArray[np.float64]

STATE_NAMES = ("x", "z", "vx", "vz", "theta")
LIFT_LEAST = 1e-6
"""Minimum of thrust_max - gravity for flights from rest to rest [m/s^2]; without it, their times would be infinite."""


def spherical_bessel(a: Any, ops: Any = np) -> tuple[Any, Any]:
    """Return j0(a) = sin a / a and j1(a) = (sin a - a cos a) / a^2, smooth at a = 0.

    `ops` supplies sin, cos and where, so that the same code serves NumPy arrays and CasADi symbols. Both closed forms
    lose digits near zero; |a| < 1/2 uses the series (error < 1e-17).
    """
    q = a * a
    small = q < 0.25
    r = ops.where(small, 1.0, a)
    j0_series = 1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110 * (1 - q / 156)))))
    j1_series = a / 3 * (1 - q / 10 * (1 - q / 28 * (1 - q / 54 * (1 - q / 88 * (1 - q / 130)))))
    sin, cos = ops.sin(r), ops.cos(r)
    return (
        ops.where(small, j0_series, sin / r),
        ops.where(small, j1_series, (sin - r * cos) / (r * r)),
    )


def exact_step(state: Any, control: Any, h: Any, gravity: Any, ops: Any = np) -> tuple[Any, ...]:
    """Return the five components of the state after h seconds of constant control.

    `state` and `control` are sequences of 5 and 2 components, arrays or symbols that broadcast. See the module
    docstring for the formulas.
    """
    x, z, vx, vz, theta = state
    thrust, rate = control
    a = rate * h / 2
    j0, j1 = spherical_bessel(a, ops)
    sin, cos = ops.sin(theta + a), ops.cos(theta + a)
    dv, dp = thrust * h, thrust * h * h / 2
    return (
        x + vx * h + dp * (j0 * sin - j1 * cos),
        z + vz * h + dp * (j0 * cos + j1 * sin) - gravity * h * h / 2,
        vx + dv * j0 * sin,
        vz + dv * j0 * cos - gravity * h,
        theta + rate * h,
    )


def nearest_turn(angle: Any, near: Any = 0.0) -> Any:
    """Return angles [rad] shifted by multiples of 2 pi to be nearest to `near`; by default into [-pi, pi]."""
    angle = as_array(angle)
    near = np.asarray(near) if isinstance(angle, np.ndarray) else near
    return angle + 2 * np.pi * namespace(angle).round((near - angle) / (2 * np.pi))


@dataclass(frozen=True)
class Quadrotor:
    """The vehicle: limits, equations of motion, exact step.

    Attributes:
        thrust_min, thrust_max: limits of the mass-normalised thrust F_T/m [m/s^2].
        rate_max: limit of the absolute pitch rate [rad/s].
        gravity: gravitational acceleration [m/s^2] (the paper does not print it).
        radius: radius of the body for collisions with hoop rims [m]; 0 is the paper's point model.

    Raises:
        ValueError: for a value that is not finite or outside its range.
    """

    thrust_min: float = 1.0
    thrust_max: float = 20.0
    rate_max: float = 10.0
    gravity: float = 9.81
    radius: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, nonnegative("Quadrotor", field.name, getattr(self, field.name)))
        if self.thrust_max <= self.thrust_min:
            raise ValueError(f"Quadrotor.thrust_max must exceed thrust_min = {self.thrust_min}, got {self.thrust_max}")
        if self.rate_max == 0:
            raise ValueError("Quadrotor.rate_max must be positive, got 0: the vehicle could not tilt")

    def require_hover(self, owner: str) -> None:
        """Raise a ValueError if the vehicle cannot rest in the air; `owner` names the vehicle in it."""
        if not self.thrust_min <= self.gravity <= self.thrust_max - LIFT_LEAST:
            raise ValueError(
                f"{owner} cannot hover, and start and goal are at rest: needs thrust_min <= gravity <= "
                f"thrust_max - {LIFT_LEAST:g}, got {self.thrust_min} <= {self.gravity} <= {self.thrust_max} - "
                f"{LIFT_LEAST:g}"
            )

    @property
    def control_low(self) -> Array:
        """Lower limits of the control [thrust, rate], shape (2,)."""
        return np.array([self.thrust_min, -self.rate_max])

    @property
    def control_high(self) -> Array:
        """Upper limits of the control [thrust, rate], shape (2,)."""
        return np.array([self.thrust_max, self.rate_max])

    def control(self, action: Any) -> Any:
        """Map actions in [-1, 1], shape (..., 2), affinely onto the control box."""
        action = as_array(action)
        low, high = (namespace(action).asarray(end, **like(action)) for end in (self.control_low, self.control_high))
        # A weighted mean of the two limits is exact at both; midpoint plus half-width is not.
        share = (action + 1) / 2
        return low * (1 - share) + high * share

    def action(self, control: ArrayLike) -> Array:
        """Map controls, shape (..., 2), affinely onto [-1, 1]; the inverse of `control`."""
        low, high = self.control_low, self.control_high
        return (2 * np.asarray(control, dtype=np.float64) - low - high) / (high - low)

    def derivative(self, state: ArrayLike, control: ArrayLike) -> Array:
        """Return d(state)/dt of eqs. (3)-(5), shapes (..., 5), (..., 2) -> (..., 5)."""
        state, control = np.asarray(state, dtype=np.float64), np.asarray(control, dtype=np.float64)
        thrust, rate, theta = control[..., 0], control[..., 1], state[..., 4]
        return np.stack(
            np.broadcast_arrays(
                state[..., 2], state[..., 3], thrust * np.sin(theta), thrust * np.cos(theta) - self.gravity, rate
            ),
            axis=-1,
        )

    def step(self, state: Any, control: Any, dt: Any) -> Any:
        """Return the exact state after `dt` seconds of constant control; arrays of NumPy, PyTorch or JAX.

        Args:
            state: [x, z, vx, vz, theta], shape (..., 5).
            control: [thrust, rate], shape (..., 2); limits are not applied here.
            dt: duration [s], shape (...); negative values integrate backwards.

        Returns:
            The new states, shape (..., 5), leading axes broadcast.
        """
        state, control = as_array(state), as_array(control)
        xp = namespace(state, control)
        parts = exact_step(
            tuple(state[..., i] for i in range(5)),
            tuple(control[..., i] for i in range(2)),
            xp.asarray(dt, **like(state)),
            self.gravity,
            xp,
        )
        return xp.stack(xp.broadcast_arrays(*parts), axis=-1)

    def fly(self, start: Any, controls: Any, dt: Any) -> Any:
        """Return the states at the ends of n successive arcs of constant control; arrays of any library.

        Each arc is computed from zero position and velocity. Position and velocity enter the equations linearly, so
        the arcs are summed, without a loop over time.

        Args:
            start: the first state, shape (..., 5).
            controls: [thrust, rate] of each arc, shape (..., n, 2); limits are not applied here.
            dt: duration of each arc [s], a number or shape (n,).

        Returns:
            The states, shape (..., n + 1, 5), starting with `start`.
        """
        start, controls = as_array(start), as_array(controls)
        xp = namespace(start, controls)
        dt = xp.broadcast_to(xp.asarray(dt, **like(start)), (controls.shape[-2],))

        def summed(change: Any) -> Any:
            return xp.cumulative_sum(change, axis=-1, include_initial=True)

        theta = start[..., 4:] + summed(controls[..., 1] * dt)
        still = xp.zeros_like(theta[..., :-1])
        change = self.step(xp.stack([still, still, still, still, theta[..., :-1]], axis=-1), controls, dt)
        columns = []
        for i in (0, 1):
            speed = start[..., 2 + i, None] + summed(change[..., 2 + i])
            place = start[..., i, None] + summed(speed[..., :-1] * dt + change[..., i])
            columns += [(place, speed)]
        (x, vx), (z, vz) = columns
        return xp.stack([x, z, vx, vz, theta], axis=-1)
